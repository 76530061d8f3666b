"""Projected gradient descent."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any

from ._descent import DescentSolver
from ._errors import PlanAssertionError
from ._space import PlanSpace

if TYPE_CHECKING:
    from collections.abc import Sequence

    import gymnasium as gym
    import torch

    from .callbacks import Callback

__all__ = ["PGDSolver"]


@dataclass(eq=False, repr=False)
class PGDSolver(DescentSolver):
    """Gradient descent on integers: their categories are relaxed to probabilities, and rounded at the end.

    The cost is given probabilities ``(b, S, H, action_block × K)`` for K categories, and must be differentiable.

    Args:
        lr: Learning rate.
        select: How plans are compared: before rounding, as in the reference (``"relaxed"``), or after (``"rounded"``,
            one evaluation more, and never fooled by a good mixture that rounds to a bad plan).

    ``solve`` returns ``actions``, ``(B, H, action_block × A)`` int64, and ``costs``.
    """

    native_name = "pgd"
    _asks_actor = False

    cost: Any
    n_steps: int
    batch_size: int | None = None
    var_scale: float = 1.0
    num_samples: int = 1
    action_noise: float = 0.0
    device: str | torch.device = "cpu"
    seed: int = 1234
    _: KW_ONLY
    lr: float = 1.0
    select: str = "relaxed"
    callbacks: Sequence[Callback] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
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

    def _holds_integers(self, plan: Any) -> bool:
        return self._from_scalar or super()._holds_integers(plan)

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

    def _costs(self) -> str:
        # The cost of the mixture that was rounded, as in the reference, unless rounded plans are compared.
        return "elite_mean" if self.select == "relaxed" else "cost"
