"""Ids of environments: which of them are this package's own. They are those of the command; `compat` has the reference's."""

from __future__ import annotations

import difflib
import logging
import sys
from collections.abc import Mapping
from functools import cache
from typing import Any, cast

from .._arguments import kind_of
from .._core import core as _swm
from .._files import offer_metaworld, offer_ogbench
from .._gym import gym_ids
from ..compat import RENAMED, is_installed
from .mazes import MAZES, OGB_MAZE, maze_of

__all__ = ["aliases", "check_recorded_id", "env_ids", "explicit", "native_env", "native_id", "nearest_id", "need", "note_renamed", "recorded_id"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")
_OURS = "swm_rs/"


@cache
def aliases() -> dict[str, str]:
    """Further spellings of ids, and the ids."""
    return dict(_swm.env_aliases())


@cache
def env_ids() -> tuple[str, ...]:
    """The ids of all environments of this package."""
    return tuple(name for name, _ in _swm.env_ids())


def native_id(env_name: str) -> str | None:
    """The id in the core of the environment that ``env_name`` means; None for those of others.

    ``swm/…`` and ``swm_rs/…`` are the same ids. Under `compat`, ``swm/…`` means what the reference calls so.

    Raises:
        TypeError: It is no text.
        EnvError: It is the name of an environment of this package without the version.
    """
    if not isinstance(cast("Any", env_name), str):
        raise TypeError(f"env_name is {kind_of(env_name)}; give the id of an environment, such as 'swm/PushT-v1'")
    _refuse_without_version(env_name)
    name = maze_of({})[0] if env_name == OGB_MAZE else _core_id(env_name, is_installed())
    if name is None:
        return None
    if not is_installed():
        note_renamed(env_name)
    need(name)
    return name


def explicit(native: str) -> str:
    """An id of the core as `native_id` takes it under `compat`, too: ``swm_rs/…``."""
    return _OURS + native.removeprefix("swm/")


def native_env(env_name: str, settings: Mapping[str, Any]) -> tuple[str | None, Mapping[str, Any]]:
    """As `native_id`, with the settings in the core: ``swm/OGBMaze-v0`` of the reference is several environments here.

    Raises:
        TypeError, EnvError: As of `native_id`; or a setting of ``swm/OGBMaze-v0`` is not available.
    """
    native = native_id(env_name)
    return maze_of(settings) if env_name == OGB_MAZE else (native, settings)


def recorded_id(env_name: str, is_of_reference: bool) -> str:
    """What records call the environment that Gymnasium has as ``env_name``: the id in the core, where it has one.

    Args:
        env_name: The id.
        is_of_reference: Whether the environment is the reference's own, under the reference's id.
    """
    return _core_id(env_name, is_of_reference) or env_name


def note_renamed(env_name: str) -> None:
    """Note that the reference has another environment under this id, once per process."""
    if env_name in RENAMED:
        _note(env_name)


@cache
def _note(env_name: str) -> None:
    logger.warning(
        "%s is the environment of the paper, as in the command; the reference's current one, which it calls %s, too, is %s here",
        env_name,
        env_name,
        RENAMED[env_name],
    )


def _core_id(env_name: str, is_of_reference: bool) -> str | None:
    if env_name.startswith(_OURS):
        name = "swm/" + env_name[len(_OURS) :]
        return aliases().get(name, name)
    name = RENAMED.get(env_name, env_name) if is_of_reference else env_name
    name = aliases().get(name, name)
    return name if name in env_ids() else None


def nearest_id(env: str) -> str | None:
    """The id of this package that a name means which is no id: without namespace or version, or misspelled; None where none is near."""
    is_ours = env.startswith(("swm/", _OURS))
    namespace = env.partition("/")[0] if is_ours else "swm"
    mine = {_bare(name): name for name in sorted(gym_ids()) if name.partition("/")[0] == namespace}
    # Names of others may be of environments that are not installed.
    near = difflib.get_close_matches(_bare(env), mine, 1, 0.6 if is_ours else 0.85)
    return mine[near[0]] if near else None


def _refuse_without_version(env: str) -> None:
    """Refuses ``swm/PushT``: gymnasium would take it for the latest version, and run it in Python."""
    bare = _bare(env)
    if env not in (f"swm/{bare}", _OURS + bare) or env in env_ids() or env in aliases():
        return
    gymnasium = sys.modules.get("gymnasium")
    meant = nearest_id(env)
    if meant is not None and _bare(meant) == bare and (gymnasium is None or env not in gymnasium.registry):
        raise _swm.EnvError(f"{env!r} names no version; give {meant!r}")


def need(env: str) -> None:
    """Make the files of an environment known that is about to be made; ``env`` is an id of the core."""
    if env.startswith("swm/OGB"):
        offer_ogbench()
    if env.startswith("swm/MetaWorld"):
        offer_metaworld()


def check_recorded_id(what: str, env: Any) -> None:
    """Compares an id for the metadata of a dataset with the known ones.

    Ids of this package (``swm/…``, ``swm_rs/…``) must exist. Others may be of environments that are not installed here: a warning names
    the nearest id of this package or of Gymnasium where one is within a few letters.

    Args:
        what: Where it was given, for the message.
        env: The id.

    Raises:
        DataError: It is no text, or an id of this package that does not exist; the message names the nearest one.
    """
    if not isinstance(env, str) or not env:
        raise _swm.DataError(f"{what} is {env!r}; give the id of an environment, such as 'swm/PushT-v1'")
    note_renamed(env)
    if env == OGB_MAZE:
        raise _swm.DataError(f"{what} is {env!r}, which is several environments here; give the id of the one that was recorded: {', '.join(MAZES)}")
    ours = {*env_ids(), *aliases(), *(_OURS + name.removeprefix("swm/") for name in env_ids())}
    gymnasium = sys.modules.get("gymnasium")
    known = ours | (set(gymnasium.registry) if gymnasium is not None else set[str]())
    if env in known or env == "unknown":
        return
    if env.startswith(("swm/", _OURS)):
        near = nearest_id(env)
        hint = f"did you mean {near!r}?" if near else "`swm.envs.WORLDS` lists them."
        raise _swm.DataError(
            f"{what} is {env!r}, which is no environment of this package; {hint} An environment of your own has another namespace: 'mylab/Name-v0'"
        )
    bare = {_bare(name): name for name in sorted(known, reverse=True)}
    near = difflib.get_close_matches(env, sorted(known), 1, 0.85)
    meant = bare.get(env) or (near[0] if near and _bare(near[0]) != _bare(env) else None)
    if meant is not None:
        logger.warning("%s is %r, which is no known environment; did you mean %r? It is kept as it is", what, env, meant)


def _bare(env: str) -> str:
    """An id without its namespace and version."""
    name = env.rpartition("/")[2]
    head, dash, version = name.rpartition("-v")
    return head if dash and version.isdigit() else name
