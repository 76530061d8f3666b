"""What `Env` and `VectorEnv` observe: step columns, or observation and goals as environments of gymnasium-robotics have them."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from .. import spaces
from .._core import core as _swm
from ..world.native import NativePool

__all__ = ["Goals", "Observed", "goals_of"]

Array = npt.NDArray[Any]
# Nearer than this to the goal is success in Fetch, m.
_REACHED = 0.05


@dataclass(frozen=True)
class Goals:
    """Observations ``observation``, ``achieved_goal`` and ``desired_goal``, and a reward that is a function of the goals.

    Args:
        observation: Columns that are joined to ``observation``. They should not depend on the goal.
        achieved_goal: The step column that is to reach the goal.
        desired_goal: The column of the goal, such as ``goal_state``.
        below: The goal is reached where the Euclidean distance of the two is not greater.
        elements: Elements of both columns; empty: all.
        dense: Whether the reward is the negative distance, rather than -1 before the goal and 0 at it.
    """

    observation: Sequence[str]
    achieved_goal: str
    desired_goal: str
    below: float
    elements: Sequence[int] = ()
    dense: bool = False

    def reward(self, achieved_goal: Array, desired_goal: Array) -> Array:
        """Rewards ``(…)`` of goals ``(…, G)``."""
        distance = np.sqrt(np.sum((np.asarray(achieved_goal) - np.asarray(desired_goal)) ** 2, axis=-1))
        return -distance if self.dense else -(distance > self.below).astype(np.float64)

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any = None) -> Any:
        """As of gymnasium-robotics: rewards ``(…)`` of goals ``(…, G)``, of one pair ``(G,)`` a number. ``info`` is not used."""
        rewards = self.reward(achieved_goal, desired_goal)
        return float(rewards) if np.ndim(rewards) == 0 else rewards

    def is_success(self, achieved_goal: Array, desired_goal: Array) -> npt.NDArray[np.bool_]:
        """Whether goals ``(…, G)`` are reached, ``(…)``."""
        return np.sum((np.asarray(achieved_goal) - np.asarray(desired_goal)) ** 2, axis=-1) <= self.below**2


def goals_of(spec: Mapping[str, Any], given: bool | Mapping[str, Any] | None) -> Goals | None:
    """The goals of an environment from its argument ``goals``; None: observations are the step columns.

    Raises:
        SwmError: The environment has no goals of its own, or lacks a column that is named.
    """
    is_fetch = spec["id"].startswith("swm/Fetch")
    if given is False or (given is None and not (is_fetch and "Dict" in spec["id"])):
        return None
    if given is None or given is True:
        if not is_fetch:
            raise _swm.SwmError(
                f"goals=True: `{spec['id']}` has no goals of its own; name them, as in goals={{'observation': ['proprio'], "
                "'achieved_goal': 'state', 'desired_goal': 'goal_state', 'below': 20.0}"
            )
        return Goals(["proprio"], "achieved_goal", "desired_goal", _REACHED, dense="Dense" in spec["id"])
    known = [field.name for field in fields(Goals)]
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            raise _swm.SwmError(f"goals: there is no `{name}`; it has {', '.join(known)}" + (f"; did you mean `{near[0]}`?" if near else ""))
    if lacking := [name for name in known[:4] if name not in given]:
        raise _swm.SwmError(f"goals: {', '.join(f'`{name}`' for name in lacking)} is missing; it needs {', '.join(known[:4])}")
    goals = Goals(**given)
    columns = {field["name"]: int(cast("Any", np.prod(field["shape"]))) for field in spec["fields"] if field["dtype"] != "str"}
    for name in (*goals.observation, goals.achieved_goal, goals.desired_goal):
        if name not in columns:
            raise _swm.SwmError(f"goals: `{spec['id']}` has no column `{name}`; it has {', '.join(columns)}")
    sizes = {columns[goals.achieved_goal], columns[goals.desired_goal]}
    if goals.elements and not all(0 <= element < min(sizes) for element in goals.elements):
        raise _swm.SwmError(f"goals: elements {list(goals.elements)} are not all in 0..{min(sizes) - 1}")
    if not goals.elements and len(sizes) > 1:
        raise _swm.SwmError(f"goals: `{goals.achieved_goal}` and `{goals.desired_goal}` have {sizes} values; choose elements")
    return goals


class Observed:
    """The observation of every environment of a pool.

    Args:
        pool: The environments.
        hides_image: Whether ``pixels`` are for `render` alone.
        goals: Of goal-conditioned observations; None: all step columns.
    """

    def __init__(self, pool: NativePool, hides_image: bool, goals: Goals | None) -> None:
        self._goals: Goals | None = goals
        columns = spaces.observation_space(pool.spec_data).spaces
        shown = {name: space for name, space in columns.items() if not (hides_image and name == "pixels")}
        if goals is not None:
            # A column such as `state` may hold the goal, which algorithms replace in `desired_goal` alone.
            sizes = {name: values.size for name, values in self._goal_values(pool, goals).items()}
            boxes = {name: gym.spaces.Box(-np.inf, np.inf, (size // pool.num_envs,), np.float64) for name, size in sizes.items()}
            shown = {**boxes, **{name: space for name, space in shown.items() if name == "pixels"}}
        #: The space of one environment.
        self.space: gym.spaces.Dict = gym.spaces.Dict(shown)
        self._shapes: dict[str, tuple[int, ...] | None] = {name: space.shape for name, space in shown.items()}

    def __contains__(self, name: str) -> bool:
        return name in self._shapes

    def values(self, pool: NativePool) -> dict[str, Array]:
        """The observation of all environments, ``(N, …)``: views of the columns where that can be."""
        found = {} if self._goals is None else self._goal_values(pool, self._goals)
        for name, shape in self._shapes.items():
            if name not in found:
                column = pool.raw(name).reshape(pool.num_envs, *(shape or ()))
                # Booleans are int8 in the space, as spaces of gymnasium have it.
                found[name] = column.view(np.int8) if column.dtype == np.bool_ else column
        return found

    @staticmethod
    def _goal_values(pool: NativePool, goals: Goals) -> dict[str, Array]:
        def column(name: str) -> Array:
            return pool.raw(name).reshape(pool.num_envs, -1).astype(np.float64)

        chosen = list(goals.elements) or slice(None)
        return {
            "observation": np.concatenate([column(name) for name in goals.observation], axis=1),
            "achieved_goal": column(goals.achieved_goal)[:, chosen],
            "desired_goal": column(goals.desired_goal)[:, chosen],
        }
