"""Action spaces of gymnasium as what a plan consists of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import gymnasium as gym

    from ..._arrays import Array

__all__ = ["PlanSpace"]


@dataclass(frozen=True)
class PlanSpace:
    """One action, as solvers see it: real numbers with bounds, or integers of so many categories each."""

    actions: int
    """A: values of an action."""
    low: list[float]
    """``(A,)``: bounds of real numbers, advice to solvers that clip."""
    high: list[float]
    categories: list[int]
    """``(A,)``: how many categories each integer has; empty for real numbers."""
    start: list[int]
    """``(A,)``: the smallest value of each integer."""

    @classmethod
    def of(cls, space: gym.Space[Any], n_envs: int) -> PlanSpace:
        """Of a batched space, ``(n_envs, ...)``. ``Discrete`` is one integer; so is ``MultiDiscrete`` of one axis,
        which is what gymnasium makes of several ``Discrete``. A ``Box`` of one axis that is not ``n_envs`` long is the
        space of a single action."""
        from gymnasium import spaces

        given: Any = space
        if isinstance(space, spaces.Discrete):
            return cls(1, [], [], [int(given.n)], [int(given.start)])
        if isinstance(space, spaces.MultiDiscrete):
            count, first = (each[0] if each.ndim > 1 else each[:1] for each in (given.nvec, given.start))
            return cls(count.size, [], [], [int(n) for n in count], [int(n) for n in first])
        if not isinstance(space, spaces.Box):
            raise TypeError(
                f"actions of {type(space).__name__} cannot be planned; make them a Box, Discrete or MultiDiscrete in a "
                "gymnasium.ActionWrapper"
            )
        is_single = len(space.shape) == 1 and space.shape[0] != n_envs
        low, high = ((bound if is_single else bound[0]).reshape(-1) for bound in (given.low, given.high))
        if np.issubdtype(given.dtype, np.integer):
            counts = [int(n) for n in high.astype(np.int64) - low.astype(np.int64) + 1]
            return cls(low.size, [], [], counts, [int(n) for n in low])
        return cls(low.size, [float(value) for value in low], [float(value) for value in high], [], [])

    @property
    def values(self) -> int:
        """Values of a plan per action: a real number is one, an integer is one-hot."""
        return sum(self.categories) if self.categories else self.actions

    def _groups(self, plans: Array) -> list[Array]:
        """Plans ``(..., k × values)``, one array ``(..., k, categories)`` per integer."""
        blocks = plans.reshape(*plans.shape[:-1], -1, self.values)
        return np.split(blocks, np.cumsum(self.categories)[:-1], axis=-1)

    def actions_of(self, plans: Array) -> Array:
        """The integers ``(..., k × A)`` int64 that plans ``(..., k × values)`` stand for."""
        chosen = [group.argmax(-1) + first for group, first in zip(self._groups(plans), self.start, strict=True)]
        stacked = np.stack(chosen, axis=-1).astype(np.int64)
        return stacked.reshape(*stacked.shape[:-2], -1)

    def one_hot(self, actions: Array) -> Array:
        """The plans ``(..., k × values)`` f32 of integers ``(..., k × A)``."""
        split = actions.reshape(*actions.shape[:-1], -1, self.actions)
        groups = [
            np.eye(count, dtype=np.float32)[split[..., index] - first]
            for index, (count, first) in enumerate(zip(self.categories, self.start, strict=True))
        ]
        joined = np.concatenate(groups, axis=-1)
        return joined.reshape(*actions.shape[:-1], -1)
