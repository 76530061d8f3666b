"""What solvers that sample plans and refit a distribution to the cheapest of them share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..._arrays import Array
from ._base import BaseSolver, torch_of
from ._bridge import Bridge

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["SamplingSolver"]


class SamplingSolver(BaseSolver):
    """The base of solvers that keep a mean and a standard deviation."""

    def __init__(
        self,
        cost: Any,
        batch_size: int,
        num_samples: int,
        var_scale: float,
        n_steps: int,
        topk: int | None,
        device: str | torch.device,
        seed: int,
        callbacks: Sequence[Callback] | None,
        *,
        clip: bool,
        return_best: bool,
    ) -> None:
        super().__init__(cost, batch_size, num_samples, device, seed, callbacks)
        self.var_scale = var_scale
        self.n_steps = n_steps
        self.topk = topk
        self.clip = clip
        self.return_best = return_best

    def settings(self) -> dict[str, Any]:
        return {
            "samples": self.num_samples,
            "iterations": self.n_steps,
            "elites": self.topk,
            "sigma": float(self.var_scale),
            "clip": self.clip,
            "return_best": self.return_best,
        }

    def _evaluations(self) -> int:
        return self.n_steps

    def init_action_distrib(
        self, n_envs: int, actions: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and standard deviation that the search begins with, ``(n_envs, H, D)`` each.

        ``actions``, ``(n_envs, t, D)``, are the beginning of the mean; zeros follow.
        """
        shape = (n_envs, self.horizon, self.action_dim)
        var = torch_of(self.cost).full(shape, float(self.var_scale), dtype=self.dtype)
        return self._continued(n_envs, actions), var

    def _finish(self, results: list[dict[str, Any]], bridges: list[Bridge]) -> dict[str, Any]:
        costs = "cost" if self.return_best else "elite_mean"

        def joined(name: str) -> Array:
            return np.concatenate([result[name] for result in results])

        return {
            "costs": joined(costs).tolist(),
            "mean": [self.as_given(joined("mean"))],
            "var": [self.as_given(joined("std"))],
        }
