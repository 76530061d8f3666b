"""The cross-entropy method."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any

from ._sampling import SamplingSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["CEMSolver"]


@dataclass(eq=False, repr=False)
class CEMSolver(SamplingSolver):
    """Samples plans around a mean, refits mean and standard deviation to the cheapest ones, repeats.

    Args:
        var_scale: Standard deviation (not variance; the name is the reference's) in the first iteration.

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

    cost: Any
    batch_size: int | None = 1
    num_samples: int = 300
    var_scale: float = 1.0
    n_steps: int = 30
    topk: int = 30
    device: str | torch.device = "cpu"
    seed: int = 1234
    callbacks: Sequence[Callback] | None = None
    _: KW_ONLY
    clip: bool = False
    sigma_min: float = 0.0
    return_best: bool = False
