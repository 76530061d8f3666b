"""Ids of environments: which of them are this package's own."""

from __future__ import annotations

import difflib
import logging
import sys
from functools import cache
from typing import Any, cast

from .._arguments import kind_of
from .._core import core as _swm
from .._files import offer_metaworld, offer_ogbench
from .._gym import gym_ids

__all__ = ["aliases", "check_recorded_id", "env_ids", "native_id", "nearest_id", "need"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")
# Ids under which the reference has what this package numbers otherwise.
RENAMED = {"swm/TwoRoom-v1": "swm/TwoRoom-v2"}
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
    """The id in this package of the environment that ``env_name`` means; None for those of others.

    ``swm/…`` means what the reference calls so (its ``TwoRoom-v1`` is our ``TwoRoom-v2``), ``swm_rs/…`` this package's
    own numbering.

    Raises:
        TypeError: It is no text.
        EnvError: It is the name of an environment of this package without the version.
    """
    if not isinstance(cast("Any", env_name), str):
        raise TypeError(f"env_name is {kind_of(env_name)}; give the id of an environment, such as 'swm/PushT-v1'")
    _refuse_without_version(env_name)
    if env_name.startswith(_OURS):
        name = "swm/" + env_name[len(_OURS) :]
        name = aliases().get(name, name)
    else:
        name = RENAMED.get(env_name, aliases().get(env_name, env_name))
        if name not in env_ids():
            return None
    need(name)
    return name


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
    """Make the files of an environment known that is about to be made; ``env`` is an id of this package's own numbering."""
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
    ours = {*env_ids(), *aliases(), *RENAMED, *(_OURS + name.removeprefix("swm/") for name in env_ids())}
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
