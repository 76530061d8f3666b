"""Predictive sampling."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ._base import BaseSolver
from ._bridge import Bridge

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["PredictiveSamplingSolver"]


class PredictiveSamplingSolver(BaseSolver):
    """Samples plans around the last one and takes the cheapest; nothing is fitted. It replans often.

    Source: Howell et al., *Predictive Sampling: Real-time Behavior Synthesis with MuJoCo* (2022).

    Args:
        cost, batch_size, num_samples, device, seed, callbacks, clip: As of
            :class:`~stable_worldmodel_rs.planning.CEMSolver`.
        noise_scale: Standard deviation of the candidates.
        n_steps: Rounds of sampling and choosing; the reference makes one.

    ``costs`` of the result are those of the plans themselves.
    """

    native_name = "predictive-sampling"
    _asks_actor = False

    def __init__(
        self,
        cost: Any,
        batch_size: int = 1,
        num_samples: int = 300,
        noise_scale: float = 1.0,
        device: str | torch.device = "cpu",
        seed: int = 1234,
        *,
        n_steps: int = 1,
        callbacks: Sequence[Callback] | None = None,
        clip: bool = False,
    ) -> None:
        super().__init__(cost, batch_size, num_samples, device, seed, callbacks)
        self.noise_scale = noise_scale
        self.n_steps = n_steps
        self.clip = clip
        self.topk = 1

    @property
    def var_scale(self) -> float:
        """The same as ``noise_scale``, under the name of other solvers."""
        return self.noise_scale

    def settings(self) -> dict[str, Any]:
        return {
            "samples": self.num_samples,
            "iterations": self.n_steps,
            "sigma": float(self.noise_scale),
            "clip": self.clip,
        }

    def _evaluations(self) -> int:
        return self.n_steps

    def init_nominal(self, n_envs: int, actions: torch.Tensor | None = None) -> torch.Tensor:
        """The plan that the search begins at, ``(n_envs, H, D)``: ``actions``, ``(n_envs, t, D)``, then zeros."""
        return self._continued(n_envs, actions)

    def _finish(self, results: list[dict[str, Any]], bridges: list[Bridge]) -> dict[str, Any]:
        return {"costs": np.concatenate([result["elite_mean"] for result in results]).tolist()}
