"""The cross-entropy method."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._sampling import SamplingSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["CEMSolver"]


class CEMSolver(SamplingSolver):
    """Samples plans around a mean, refits mean and standard deviation to the cheapest ones, repeats.

    Args:
        cost: What to minimize: anything with ``get_cost`` (:class:`~stable_worldmodel_rs.protocols.Costable`).
        batch_size: Rows that the cost is given at once. Plans do not depend on it.
        num_samples: S, candidates per iteration.
        var_scale: Standard deviation (not variance; the name is the reference's) in the first iteration.
        n_steps: Iterations.
        topk: Candidates that a refit uses.
        device: Where the cost is given its candidates.
        seed: Seed of the noise, in addition to the episode's.
        callbacks: Recorders of every iteration, see :mod:`stable_worldmodel_rs.planning.solver.callbacks`.
        clip: Clip candidates to the bounds of the actions. The reference does not.
        sigma_min: Smallest standard deviation after a refit; above 0 the search never collapses.
        return_best: Return the cheapest candidate of all iterations, not the final mean.

    ``solve`` returns ``actions``, the final mean; ``costs``, the mean cost of the last elites (with ``return_best`` that
    of the plan); ``mean`` and ``var``, lists of one ``(B, H, D)``, where ``var`` is a standard deviation.

    Example:
        >>> import gymnasium as gym
        >>> import numpy as np
        >>> from stable_worldmodel_rs import PlanConfig
        >>> from stable_worldmodel_rs.planning import CEMSolver
        >>> class Sum:
        ...     array_api = "numpy"
        ...     def get_cost(self, info, candidates):  # (b, S, H, D) -> (b, S)
        ...         return (candidates.sum(axis=(2, 3)) - 2.0) ** 2
        >>> solver = CEMSolver(Sum(), n_steps=10)
        >>> actions = gym.spaces.Box(-1, 1, (4, 2), np.float32)
        >>> solver.configure(action_space=actions, n_envs=4, config=PlanConfig(horizon=5, receding_horizon=5))
        >>> plan = solver.solve({"state": np.zeros((4, 3))})
        >>> plan["actions"].shape
        (4, 5, 2)
    """

    native_name = "cem"

    def __init__(
        self,
        cost: Any,
        batch_size: int = 1,
        num_samples: int = 300,
        var_scale: float = 1.0,
        n_steps: int = 30,
        topk: int = 30,
        device: str | torch.device = "cpu",
        seed: int = 1234,
        callbacks: Sequence[Callback] | None = None,
        *,
        clip: bool = False,
        sigma_min: float = 0.0,
        return_best: bool = False,
    ) -> None:
        super().__init__(
            cost,
            batch_size,
            num_samples,
            var_scale,
            n_steps,
            topk,
            device,
            seed,
            callbacks,
            clip=clip,
            return_best=return_best,
        )
        self.sigma_min = sigma_min

    def settings(self) -> dict[str, Any]:
        return {**super().settings(), "sigma_min": float(self.sigma_min)}
