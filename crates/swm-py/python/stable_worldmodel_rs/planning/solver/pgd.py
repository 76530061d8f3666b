"""Projected gradient descent."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..._arrays import Array
from ._bridge import Bridge
from ._descent import DescentSolver
from ._errors import PlanAssertionError
from ._space import PlanSpace

if TYPE_CHECKING:
    from collections.abc import Sequence

    import gymnasium as gym
    import torch

    from .callbacks import Callback

__all__ = ["PGDSolver"]


class PGDSolver(DescentSolver):
    """Gradient descent on integers: their categories are relaxed to probabilities, and rounded at the end.

    The cost is given probabilities ``(b, S, H, action_block × K)`` for K categories, and must be differentiable.

    Args:
        cost, n_steps, batch_size, var_scale, num_samples, action_noise, device, seed, callbacks: As of
            :class:`~stable_worldmodel_rs.planning.GradientSolver`.
        lr: Learning rate.
        select: How plans are compared: before rounding, as in the reference (``"relaxed"``), or after (``"rounded"``,
            one evaluation more, and never fooled by a good mixture that rounds to a bad plan).

    ``solve`` returns ``actions``, ``(B, H, action_block × A)`` int64, and ``costs``.
    """

    native_name = "pgd"
    _asks_actor = False

    def __init__(
        self,
        cost: Any,
        n_steps: int,
        batch_size: int | None = None,
        var_scale: float = 1.0,
        num_samples: int = 1,
        action_noise: float = 0.0,
        device: str | torch.device = "cpu",
        seed: int = 1234,
        *,
        lr: float = 1.0,
        select: str = "relaxed",
        callbacks: Sequence[Callback] | None = None,
    ) -> None:
        super().__init__(cost, n_steps, batch_size, var_scale, num_samples, action_noise, device, seed, callbacks)
        self.lr = lr
        self.select = select
        self._action_simplex_dim: int | None = None
        self._from_scalar = False

    def configure(self, *, action_space: gym.Space[Any], n_envs: int, config: Any) -> None:
        super().configure(action_space=action_space, n_envs=n_envs, config=config)
        self._action_simplex_dim = self._require_configured().values

    def _check_space(self, space: PlanSpace) -> None:
        if not space.categories:
            raise PlanAssertionError(
                f"PGDSolver plans integers, and the action space is {self._action_space}; use GradientSolver(clip=True) "
                "for real numbers"
            )

    @property
    def action_simplex_dim(self) -> int:
        """Values of a block of one-hot actions."""
        return self._require_configured().values * self._config.action_block

    def settings(self) -> dict[str, Any]:
        return {**super().settings(), "lr": float(self.lr), "select": self.select}

    def _evaluations(self) -> int:
        # The ends, and for `rounded` what they round to; not the chosen plan once more.
        return 1 if self.select == "relaxed" else 1 << 62

    def solve(
        self, info_dict: dict[str, Any], init_action: Any = None, from_scalar: bool = False, **kwargs: Any
    ) -> dict[str, Any]:
        """As of other solvers. ``init_action`` holds probabilities ``(B, t, action_block × K)``, or integers
        ``(B, t, action_block × A)``, which ``from_scalar`` says, and their type does."""
        self._from_scalar = from_scalar
        try:
            return super().solve(info_dict, init_action, **kwargs)
        finally:
            self._from_scalar = False

    def _given(self, init_action: Any) -> Array:
        kind = str(getattr(init_action, "dtype", ""))
        if self._from_scalar or "int" in kind:
            values = init_action.cpu().numpy() if hasattr(init_action, "cpu") else np.asarray(init_action)
            return self._require_configured().one_hot(values.astype(np.int64))
        return super()._given(init_action)

    def init_action(self, actions: torch.Tensor | None = None, from_scalar: bool = False) -> None:
        """Sets ``init`` to the sequences that the next ``solve`` begins with, ``(n_envs, S, H, action_block × K)``.

        ``actions``, ``(n_envs, t, action_block × K)`` (integers: ``(n_envs, t, action_block × A)``), are the beginning of
        the first sequence; zeros follow.
        """
        self._from_scalar = from_scalar
        try:
            self.init: torch.Tensor = self._starts(self.n_envs, actions, iterations=0)
        finally:
            self._from_scalar = False

    def _factor_action_block(self, actions: Any) -> Any:
        """Plans ``(..., action_block × K)`` as ``(..., action_block, K)``."""
        return actions.reshape(*actions.shape[:-1], self._config.action_block, self._action_simplex_dim)

    def _finish(self, results: list[dict[str, Any]], bridges: list[Bridge]) -> dict[str, Any]:
        costs = "elite_mean" if self.select == "relaxed" else "cost"
        return {"costs": np.concatenate([result[costs] for result in results]).tolist()}
