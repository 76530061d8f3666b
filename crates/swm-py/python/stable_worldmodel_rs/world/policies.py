"""Policies of the core by their names, as on the command line: `expert`, `cem:samples=300`."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, ItemsView, Iterable, Iterator, Mapping, ValuesView
from copy import copy
from functools import partial, wraps
from pathlib import Path
from typing import Any, TypeGuard, TypeVar, cast

import numpy as np
import numpy.typing as npt

from .._arguments import kind_of
from .._core import core as _swm
from .native import whole


# An error names at most so many columns of infos.
_MOST_COLUMNS = 12
# What results call a reference policy, and the policy that it is.
_ALIASES = {"no-op": "constant", "no_op": "constant"}


class NativePolicy:
    """A policy of the core, which runs whole episodes without Python.

    Args:
        text: Name and arguments: ``"random"``, ``"noisy-expert:std=0.2"``, ``"cem:samples=300,horizon=5"``;
            ``"cem:@file.json"`` takes the arguments from a file (JSON or TOML), and ``"no-op"`` is ``"constant"`` without values. ``swm-rs envs ENV`` lists the policies of
            an environment.
        seed: Seed of its own noise; 0: noise comes from the episodes' seeds.
        **settings: Further arguments.

    Example:
        >>> NativePolicy("cem", samples=300).text
        'cem:samples=300'
    """

    def __init__(self, text: str, *, seed: int = 0, **settings: Any) -> None:
        name, _, rest = text.partition(":")
        name = _ALIASES.get(name.strip(), name)
        parts = [part for part in rest.split(",") if part]
        if parts and parts[0].startswith("@"):
            given = {**_read(Path(parts.pop(0)[1:])), **settings}
        else:
            given = settings
        parts += [f"{key}={_literal(value)}" for key, value in given.items()]
        self.text: str = name + (":" + ",".join(parts) if parts else "")
        self.seed: int = whole("seed", seed)

    def __repr__(self) -> str:
        return f"NativePolicy({self.text!r})"


class FunctionPolicy:
    """A function of the infos as a policy.

    Args:
        function: Takes the infos, arrays ``(N, 1, …)``, and returns actions ``(N, *A)``.
    """

    def __init__(self, function: Callable[[dict[str, Any]], Any]) -> None:
        self.get_action = function

    def describe(self) -> str:
        """The function's name."""
        return str(getattr(self.get_action, "__name__", "function"))


def _is_function(policy: object) -> TypeGuard[Callable[[dict[str, Any]], Any]]:
    """Whether it is a function or a method; what it takes shows in its first call."""
    return inspect.isroutine(policy) or isinstance(policy, partial)


def as_policy(policy: Any) -> Any:
    """An object with ``get_action``: the policy, or a function as one.

    Raises:
        TypeError: It is neither.
    """
    if isinstance(policy, type):
        raise TypeError(f"a policy is an object, and {policy.__name__} is its class; make one: {policy.__name__}()")
    if callable(getattr(policy, "get_action", None)):
        return policy
    if _is_function(policy):
        return FunctionPolicy(policy)
    raise TypeError(
        f"a policy is a name such as 'expert', a function of the infos, or an object with get_action(infos), found {policy!r}"
    )


def describe(policy: Any) -> str:
    """What a policy is called in records: what its ``describe()`` says, else its class."""
    own = getattr(policy, "describe", None)
    return str(own()) if callable(own) else type(policy).__name__


def ask(policy: Any, infos: dict[str, Any], space: Any) -> Any:
    """The actions that a policy returns for the infos; ``space`` is that of all environments' actions.

    The policy gets infos of its own, to keep or to change: what is recorded stays as it is.

    Raises:
        PolicyError: It returned None, as a function without ``return`` does, or what is no array of actions.
    """
    try:
        actions = policy.get_action(PolicyInfos(infos))
    except _swm.SwmError:
        raise
    except Exception as error:
        if hasattr(error, "add_note"):
            shown = [f"{name} {list(value.shape)} {value.dtype}" for name, value in infos.items() if hasattr(value, "dtype")]
            more = ", …" if len(shown) > _MOST_COLUMNS else ""
            error.add_note(f"the policy `{describe(policy)}` was given the infos {', '.join(shown[:_MOST_COLUMNS])}{more}")
        raise
    if actions is not None and space.shape is None:
        return actions  # Of several parts, which the environments take apart.
    what = "whole numbers" if "Discrete" in type(space).__name__ else "real numbers"
    return as_actions(f"the policy `{describe(policy)}` returned", actions, tuple(space.shape or ()), what)


def as_actions(
    told: str, actions: Any, shape: tuple[int, ...], what: str = "real numbers", must: str = "it must return"
) -> npt.NDArray[Any]:
    """What a policy returned, as an array of actions: tensors of any device and type come to the CPU, without their gradient.

    Args:
        told: The beginning of an error: who returned them.
        actions: What was returned.
        shape: Of the actions, ``(N, *A)``. Axes of length 1 may come and go.
        what: What actions are.
        must: How an error goes on.

    Raises:
        PolicyError: It is none; the message has its kind and shape, and the fix.
    """
    try:
        if isinstance(actions, (list, tuple)) and any(map(_is_tensor, cast("list[Any]", actions))):
            array = np.stack([_numpy(one) for one in cast("list[Any]", actions)])
        else:
            array = _numpy(actions)
    except (TypeError, ValueError, NotImplementedError):
        array = None
    if array is not None and array.dtype.kind in "biuf" and array.size == int(np.prod(shape)):
        # Whether its shape fits is for the environments to say.
        return array
    found = _given(actions) if array is None or array.dtype.kind not in "biuf" else f"{array.dtype} of shape {list(array.shape)}"
    raise _swm.PolicyError(
        f"{told} {found}; {must} actions of shape {shape}, one row per environment, [N, *A]: {what}, as an array, a "
        f"tensor or lists{_fix(actions, array, shape)}"
    )


_F = TypeVar("_F", bound=Callable[..., Any])


def explains_actions(function: _F) -> _F:
    """Adds to an error of actions that are not finite where they come from, in most cases; a decorator."""

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except _swm.PolicyError as error:
            if "is not finite" in str(error) and hasattr(error, "add_note"):
                error.add_note(
                    "actions [N, *A] are finite real numbers. A network returns NaN for an input that is NaN or far out of the range that it was "
                    "trained on, and with weights that are NaN: compare torch.isfinite of the infos that the policy reads and of "
                    "model.parameters(); for actions that are only too large, np.clip(actions, space.low, space.high)"
                )
            raise

    return cast("_F", call)


def _fix(actions: Any, array: npt.NDArray[Any] | None, wanted: tuple[int, ...]) -> str:
    """What a user may have meant, by what was returned."""
    if actions is None:
        return "; end the function with `return`"
    if isinstance(actions, dict):
        return "; return the value of the key that holds the actions"
    if hasattr(actions, "rsample") or hasattr(actions, "log_prob"):
        return "; return a sample of the distribution, or its mean: distribution.sample(), distribution.mean"
    first = next(iter(cast("tuple[Any, ...]", actions)), None) if isinstance(actions, tuple) else None
    if array is None and getattr(first, "shape", None) == wanted:
        return "; return its first part alone"
    if str(getattr(cast("Any", actions), "device", "")) == "meta":
        return "; the model is on the device `meta`, which holds no values: load its weights on 'cpu'"
    if array is not None and array.dtype.kind == "c":
        return "; return the real part"
    if array is not None and len(wanted) > 1 and array.shape == wanted[1:] and wanted[0] > 1:
        return "; one action was returned for all environments: np.tile(action, (N, 1)), or act on each row of the infos"
    return ""


def _is_tensor(value: Any) -> bool:
    return hasattr(value, "detach") and hasattr(value, "cpu")


def _numpy(value: Any) -> npt.NDArray[Any]:
    """An array of a value; of a tensor without its gradient."""
    if not _is_tensor(value):
        return np.asarray(value)
    value = value.detach().cpu()
    # NumPy has no bfloat16.
    return np.asarray((value.float() if str(value.dtype) == "torch.bfloat16" else value).numpy())


def _given(value: Any) -> str:
    """A value by its kind and shape."""
    if value is None:
        return "None"
    shape = getattr(value, "shape", None)
    if isinstance(value, (list, tuple)):
        parts = [_given(one) for one in cast("list[Any]", value)[:3]]
        return f"a {kind_of(cast('Any', value))} of {', '.join(parts)}" + (", …" if len(cast("list[Any]", value)) > 3 else "")
    if shape is not None and isinstance(shape, tuple):
        return f"{kind_of(value)} of shape {list(cast('tuple[int, ...]', shape))}, {value.dtype}"
    return f"{value!r}" if isinstance(value, (int, float, str)) else kind_of(value)


class PolicyInfos(dict[str, Any]):
    """The infos of a step as a policy gets them: every column is copied where it is read first, and then the policy's own."""

    # Names of columns that were not read yet: views of what is recorded.
    _shared: set[str] = set()

    def __init__(self, infos: Mapping[str, Any] | Iterable[tuple[str, Any]] = ()) -> None:
        super().__init__(infos)
        self._shared = set(super().keys())

    def __getitem__(self, name: str) -> Any:
        value = super().__getitem__(name)
        if name in self._shared:
            self[name] = value = _own(value)
        return value

    def __missing__(self, name: str) -> Any:
        fix = "; make the World with image_shape=(height, width)" if name in ("pixels", "goal") else ""
        raise KeyError(f"the infos have no {name!r}{fix}; they have {', '.join(map(str, self))}")

    def __setitem__(self, name: str, value: Any) -> None:
        if name in self._shared:
            self._shared.remove(name)
        super().__setitem__(name, value)

    def __iter__(self) -> Iterator[str]:
        # With a method of its own, `dict(infos)` and `{**infos}` read by `__getitem__`.
        return super().__iter__()

    def get(self, name: str, default: Any = None) -> Any:
        """As of `dict`."""
        return self[name] if name in self else default

    def pop(self, name: str, *default: Any) -> Any:
        """As of `dict`."""
        if name in self:
            self[name]
        return super().pop(name, *default)

    def items(self) -> ItemsView[str, Any]:  # type: ignore[override]
        """As of `dict`."""
        return ItemsView(self)

    def values(self) -> ValuesView[Any]:  # type: ignore[override]
        """As of `dict`."""
        return ValuesView(self)

    def copy(self) -> dict[str, Any]:
        """As of `dict`."""
        return dict(self)


def _own(values: Any) -> Any:
    """A copy of a column of the infos: an array, a tensor, or lists of lists."""
    if isinstance(values, list):
        return [list(row) for row in cast("list[list[Any]]", values)]
    return values.clone() if hasattr(values, "clone") else copy(values)


def _literal(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _read(path: Path) -> dict[str, Any]:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".json":
        return dict(json.loads(text))
    try:
        import tomllib
    except ImportError:
        raise ValueError(f"{path}: TOML needs Python 3.11 or later; use a JSON file") from None
    return dict(tomllib.loads(text))
