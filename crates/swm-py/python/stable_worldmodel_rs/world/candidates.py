"""Candidates for an evaluation on a manifest: a policy of the core by its name, or one in Python with its settings and files."""

from __future__ import annotations

import hashlib
import inspect
import json
import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from .._arguments import kind_of
from .._arrays import is_module
from .ids import explicit
from .native import whole
from .policies import NativePolicy, as_policy, describe
from .world import World

# Arguments of constructors that are no settings: results do not depend on them.
_NO_SETTINGS = frozenset({"self", "args", "kwargs", "device", "callbacks", "env"})
# How deep objects in objects are described: policy, solver, cost, model.
_DEPTH = 3


class Candidate(NamedTuple):
    """A policy as the core takes it."""

    name: str
    seed: int
    foreign: Any
    """Of a policy in Python: its World, what is called before episodes begin, its actions, its settings, its files."""


class ByName(str):
    """A setting of which a receipt has the name alone: what it holds is not compared."""


@contextmanager
def candidate_of(
    manifest: Mapping[str, Any],
    policy: Any,
    *,
    name: str | None,
    weights: Sequence[str | PathLike[str]],
    seed: int,
    num_envs: int,
    threads: int | None,
    world: Mapping[str, Any],
) -> Generator[Candidate, None, None]:
    """The policy that is to act on ``manifest``; the World of one in Python is closed in the end.

    Raises:
        TypeError: It is no policy, or ``name``, ``weights`` or arguments of a World go with a policy of the core.
        FileNotFoundError: One of ``weights`` is not there.
    """
    seed = whole("policy_seed", seed)
    if isinstance(policy, str):
        policy = NativePolicy(policy)
    if isinstance(policy, NativePolicy):
        policy, seed = policy.text, seed or policy.seed
        given = [*(["name"] if name is not None else []), *(["weights"] if weights else []), *world]
        if given:
            raise TypeError(
                f"{', '.join(given)}: for policies in Python; `{policy}` is one of the core, whose name, settings and files are recorded"
            )
        yield Candidate(policy, seed, None)
        return
    policy = as_policy(policy)
    files = _files(weights)
    settings = {**settings_of(policy), **{f"world.{key}": _described(value) for key, value in world.items()}}
    default = describe(policy) if not settings else type(policy).__name__
    with _world_for(manifest, min(num_envs, len(manifest["pairs"])), threads, world) as live:
        live.set_policy(policy)
        acting = _Acting(live)
        foreign = (live._native(), acting.begin, acting.act, json.dumps(settings), files)  # pyright: ignore[reportPrivateUsage]
        yield Candidate(name or default, seed, foreign)


class _Acting:
    """A policy's actions in runs that follow each other."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._act = world._driver(None)  # pyright: ignore[reportPrivateUsage]
        self._is_new = False

    def begin(self) -> None:
        """A run begins: what the policy remembers belongs to another one."""
        self._is_new = True

    def act(self, begun: npt.NDArray[np.bool_] | None) -> Any:
        """Actions ``(N, …)``; ``begun``: the environments that have begun another episode."""
        assert self._act is not None, "a policy in Python acts itself"
        if self._is_new:
            self._is_new = False
            steps = np.asarray(self._world.infos["step_idx"]).reshape(self._world.num_envs, -1)[:, -1]
            begun = steps == 0
        return self._act(begun)


def _world_for(manifest: Mapping[str, Any], num_envs: int, threads: int | None, given: Mapping[str, Any]) -> World:
    image = manifest.get("image")
    shape = given.get("image_shape", None if image is None else (image["height"], image["width"]))
    options: dict[str, Any] = {
        "max_episode_steps": manifest["budget"],
        "frame_skip": manifest["frame_skip"],
        "distractors": manifest.get("distractors", ()),
        "threads": threads,
        "image_shape": shape,
        "add_pixels": shape is not None,
        **manifest.get("settings", {}),
        **{name: value for name, value in given.items() if name != "image_shape"},
    }
    return World(explicit(manifest["env"]), num_envs, **options)


def _files(weights: Sequence[str | PathLike[str]]) -> list[str]:
    if isinstance(weights, (str, PathLike)):
        raise TypeError(f"weights={weights!r}: give a list of files, such as weights=[{fspath(weights)!r}]")
    paths = [Path(path).expanduser() for path in weights]
    if missing := next((path for path in paths if not path.exists()), None):
        raise FileNotFoundError(f"no such file: {missing}, one of weights")
    return [str(path) for path in paths]


def settings_of(policy: Any) -> dict[str, Any]:
    """The settings of a policy in Python, by name, as JSON has values.

    They are what its method ``settings()`` returns, or else the arguments of its constructor that it keeps as attributes, with those
    of its solver, its cost and its plans. Scalings and transforms are described by their kind and, with ``#``, a hash of their values, and files
    by their name and a hash of their content, wherever they are.
    """
    found: dict[str, Any] = {}
    _collect(found, policy, "", _DEPTH)
    return found


def _collect(found: dict[str, Any], of: Any, prefix: str, depth: int) -> None:
    own = getattr(of, "settings", None)
    if callable(own):
        given = cast("Mapping[str, Any]", own())
        found |= {prefix + str(name): _described(value) for name, value in given.items()}
    # A solver of this package has said what its constructor was given, but for these.
    names = ("seed", "batch_size", "cost") if callable(own) else _arguments(of)
    for name in names:
        value = _kept(of, name)
        if value is _MISSING:
            continue
        has_settings = callable(getattr(value, "settings", None))
        if is_dataclass(value) and not isinstance(value, type) and not has_settings:
            for field in fields(value):
                # What a solver has under the same name stays.
                free = prefix + field.name not in found
                found[prefix + field.name if free else f"{prefix}{name}.{field.name}"] = _described(getattr(value, field.name))
        elif isinstance(value, Mapping):
            columns = cast("Mapping[str, Any]", value)
            found |= {f"{prefix}{name}.{key}": _described(one) for key, one in columns.items()}
        elif _is_plain(value) or depth == 0 or inspect.isroutine(value):
            found[prefix + name] = _described(value)
        else:
            found[prefix + name] = type(value).__name__
            _collect(found, value, "" if name == "solver" else f"{prefix}{name}.", depth - 1)


_MISSING: Any = object()


def _arguments(of: Any) -> list[str]:
    """The names of the arguments of its class."""
    try:
        parameters = inspect.signature(type(of).__init__).parameters.values()
    except (TypeError, ValueError):
        return []
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return [one.name for one in parameters if one.kind not in kinds and one.name not in _NO_SETTINGS]


def _kept(of: Any, name: str) -> Any:
    """The attribute that holds an argument of the constructor."""
    for attribute in (name, f"_{name}", *(["cfg"] if name == "config" else [])):
        if attribute in getattr(of, "__dict__", {}):
            return getattr(of, attribute)
    # Modules of torch keep modules elsewhere.
    return getattr(of, name, _MISSING) if name in getattr(of, "_modules", {}) else _MISSING


def _is_plain(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return all(_is_plain(one) for one in value)  # pyright: ignore[reportUnknownVariableType]
    return value is None or isinstance(value, (bool, int, float, str, np.generic, PathLike))


def _path(value: Any) -> str | None:
    """A path without its folder, so that a receipt agrees wherever its files are: the name and, of a file, a hash of its content. None: it is
    no path. A text is one where it names a file by a folder or an ending."""
    if not isinstance(value, (str, PathLike)):
        return None
    text = fspath(cast("str | PathLike[Any]", value))
    if not isinstance(text, str):
        return None
    path = Path(text).expanduser()
    try:
        is_file = path.is_file()
    except (OSError, ValueError):
        is_file = False
    if isinstance(value, str) and not (is_file and (path.suffix or path.name != text)):
        return None
    if not is_file:
        return path.name or text
    with path.open("rb") as stream:
        digest = hashlib.sha256()
        while block := stream.read(1 << 20):
            digest.update(block)
    return f"{path.name}#{digest.hexdigest()[:12]}"


def _placeless(value: Any) -> Any:
    """A plain value with its paths as `_path` has them."""
    if isinstance(value, (list, tuple)):
        parts = [_placeless(one) for one in cast("list[Any]", value)]
        return parts if isinstance(value, list) else tuple(parts)
    found = _path(value)
    return value if found is None else found


def _described(value: Any) -> Any:
    """A value as JSON has it; of other objects the kind, and a hash of what they hold."""
    if isinstance(value, np.generic):
        return _described(cast("Any", value).item())
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if (path := _path(value)) is not None:
        return path
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, (list, tuple)):
        return [_described(one) for one in cast("list[Any]", value)]
    if inspect.isroutine(value) or isinstance(value, type):
        return ByName(value.__qualname__)
    digest = hashlib.sha256()
    states = [(name, _bytes(state)) for name, state in sorted(getattr(value, "__dict__", {}).items())]
    for name, state in states:
        if state is not None:
            digest.update(f"{name}=".encode() + state + b"\n")
    kind = type(value).__name__
    if any(state is not None for _, state in states):
        return f"{kind}#{digest.hexdigest()[:12]}"
    # Of an object without any state, its class is all that there is.
    return ByName(kind) if states else kind


def compared_by_name(policy: Any, world: Mapping[str, Any]) -> list[str]:
    """The settings of a policy in Python, and arguments of its World, that a receipt has by their names alone: functions, and objects that hold
    no numbers."""
    settings = {**settings_of(policy), **{f"world.{key}": _described(value) for key, value in world.items()}}
    return [name for name, value in settings.items() if isinstance(value, ByName)]


def networks_of(policy: Any, depth: int = _DEPTH) -> list[str]:
    """The kinds of the networks of torch that a policy holds: itself, its model, its solver's cost, and what that holds."""
    found: list[str] = []
    if is_module(policy):
        return [kind_of(policy)] if next(iter(policy.parameters()), None) is not None else []
    of: Any = policy
    held: dict[str, Any] = getattr(of, "__dict__", {}) if depth else {}
    for value in held.values():
        if not _is_plain(value) and not inspect.isroutine(value) and not isinstance(value, (type, np.ndarray, Mapping)):
            found += [kind for kind in networks_of(value, depth - 1) if kind not in found]
    return found


def _bytes(state: Any) -> bytes | None:
    """Numbers, texts and arrays as bytes; None for what is neither."""
    if hasattr(state, "detach"):
        state = state.detach().cpu().numpy()
    if isinstance(state, (np.ndarray, np.generic)):
        array: npt.NDArray[Any] = np.ascontiguousarray(cast("Any", state))
        return f"{array.dtype}{array.shape}".encode() + array.tobytes()
    return repr(_placeless(state)).encode() if _is_plain(state) else None
