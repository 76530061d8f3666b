"""The environments in gymnasium: ``gymnasium.make("swm/PushT-v1")``, and what there is to choose from.

Ids are those of the command; ``swm_rs/…`` are the same as ``swm/…``, for programs in which the reference has ``swm/…``. Both are
registered by ``import stable_worldmodel_rs``.
"""

from __future__ import annotations

import json
from importlib import import_module
from typing import Any

from .._core import core as _swm
from .._gym import gym_ids, register_all
from .env import Env
from .observed import Goals

__all__ = ["DISCRETE_WORLDS", "WORLDS", "Env", "Goals", "gym_ids", "info", "register", "register_all"]

#: Ids of all environments of this package.
WORLDS: set[str] = {name for name in gym_ids() if name.startswith("swm/")}
#: Those of them whose actions are integers.
DISCRETE_WORLDS: set[str] = {name for name in WORLDS if "Discrete" in name}


def register(id: str, entry_point: Any, discrete: bool = False, **kwargs: Any) -> None:
    """Register an environment of your own in gymnasium, and in ``WORLDS``. It runs in Python.

    Args:
        id: ``"mine/Maze-v0"``.
        entry_point: A class, a function, or ``"module:name"``.
        discrete: Whether its actions are integers.
        **kwargs: As of ``gymnasium.register``.
    """
    # By name: its functions have types that are partly unknown.
    registration: Any = import_module("gymnasium.envs.registration")
    registration.register(id=id, entry_point=entry_point, **kwargs)
    WORLDS.add(id)
    if discrete:
        DISCRETE_WORLDS.add(id)


def info(env_name: str | None = None) -> Any:
    """What an environment is: ``summary``, ``settings`` as (name, what it does, default), ``policies``.

    Args:
        env_name: ``"swm/PushT-v1"``; None: a list of all.
    """
    from ..world.ids import native_id, nearest_id

    every: list[dict[str, Any]] = json.loads(_swm.environments())
    if env_name is None:
        return every
    name = native_id(env_name)
    found = next((one for one in every if one["id"] == name), None)
    if found is None:
        from gymnasium.error import NameNotFound

        near = nearest_id(env_name)
        hint = f"it has {', '.join(sorted(WORLDS))}" if near is None else f"did you mean {near!r}? swm.envs.WORLDS lists all"
        raise NameNotFound(f"`{env_name}` is no environment of this package; {hint}")
    return found
