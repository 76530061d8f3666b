"""``swm/OGBMaze-v0``: OGBench's mazes as the reference spells them, one id whose settings choose between environments of the core."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .._core import core as _swm

__all__ = ["MAZES", "OGB_MAZE", "maze_of"]

OGB_MAZE = "swm/OGBMaze-v0"
# Settings ``loco_env_type`` and ``maze_env_type``, and the environment.
_ENVS = {
    ("point", "maze"): "swm/OGBPointMaze-v0",
    ("ant", "maze"): "swm/OGBAntMaze-v0",
    ("humanoid", "maze"): "swm/OGBHumanoidMaze-v0",
    ("ant", "ball"): "swm/OGBAntSoccer-v0",
}
#: The environments of the core.
MAZES: tuple[str, ...] = tuple(_ENVS.values())
_IMAGES = "images are the column `pixels`: give image_shape=(height, width)"
# Settings that have one value here, and what to do about others.
_FIXED: dict[str, tuple[Any, str]] = {
    "ob_type": ("states", _IMAGES),
    "success_timing": ("post", "success is checked after the step"),
    "add_noise_to_goal": (True, "goals are up to 1 m off the center of their cells"),
    "use_oracle_rep": (False, "the position of the goal is the column `goal_xy`"),
    "maze_unit": (4.0, "cells have 4 m"),
    "maze_height": (0.5, "walls have the height of OGBench's tasks"),
}


def maze_of(settings: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The id in the core and the settings there of ``swm/OGBMaze-v0`` with these settings of the reference.

    As there, a start and a goal are those of one of the maze's tasks, which ``reward_task_id`` fixes. Settings of the core are kept.

    Raises:
        EnvError: A setting has a value that is not available.
    """
    given = dict(settings)
    body, kind = given.pop("loco_env_type", "point"), given.pop("maze_env_type", "maze")
    _one_of("loco_env_type", body, ("point", "ant", "humanoid"))
    _one_of("maze_env_type", kind, ("maze", "ball"))
    if (body, kind) not in _ENVS:
        raise _swm.EnvError(f"{OGB_MAZE}: maze_env_type='ball' is not available with loco_env_type={body!r}; give loco_env_type='ant'")
    for name, (value, advice) in _FIXED.items():
        if name in given and (other := given.pop(name)) != value:
            raise _swm.EnvError(f"{OGB_MAZE}: {name}={other!r} is not available; leave it out, {advice}")
    for name in ("width", "height"):
        if name in given:
            raise _swm.EnvError(f"{OGB_MAZE}: {name}= is not available; leave it out, {_IMAGES}")
    task = given.pop("reward_task_id", None)
    if task is not None:
        if "task" in given:
            raise _swm.EnvError(f"{OGB_MAZE}: task and reward_task_id are the same setting; give one of them")
        # 0 is OGBench's default task.
        given["task"] = task or (4 if kind == "ball" else 1)
    given.setdefault("mode", "task")
    return _ENVS[body, kind], given


def _one_of(name: str, value: Any, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise _swm.EnvError(f"{OGB_MAZE}: {name}={value!r} is not available; give {', '.join(map(repr, choices[:-1]))} or {choices[-1]!r}")
