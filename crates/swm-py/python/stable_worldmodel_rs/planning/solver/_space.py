"""Action spaces of gymnasium as what a plan consists of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
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
    """``(A,)``: bounds of real numbers, in units of plans."""
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

    @cached_property
    def _inner(self) -> tuple[Array, Array]:
        """The bounds as f32, never wider than they are: 0.1 becomes larger in f32."""
        bounds: list[Array] = []
        for given, inward in ((self.low, np.float32(np.inf)), (self.high, np.float32(-np.inf))):
            exact = np.asarray(given, np.float64)
            rounded = exact.astype(np.float32)
            outside = rounded < exact if inward > 0 else rounded > exact
            bounds.append(np.where(outside, np.nextafter(rounded, inward), rounded))
        return bounds[0], bounds[1]

    def clip(self, plans: Array) -> Array:
        """Plans ``(..., k × A)`` f32 of real numbers within the bounds."""
        return np.clip(plans.reshape(-1, self.actions), *self._inner).reshape(plans.shape)

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
