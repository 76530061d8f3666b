"""MPPI: model-predictive path integral control."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._sampling import SamplingSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["MPPISolver"]


class MPPISolver(SamplingSolver):
    """The plan is the mean of its samples, weighted by a softmax of minus their costs; their std is fixed.

    Source: Williams et al., *Information-Theoretic Model Predictive Control* (2018).

    Args:
        cost, batch_size, num_samples, var_scale, n_steps, device, seed, callbacks, clip, return_best: As of
            :class:`~stable_worldmodel_rs.planning.CEMSolver`.
        topk: Cheapest candidates that have a weight; None: all.
        temperature: Additional cost that makes a weight e times smaller.
        temperature_mode: Unit of the temperature: the cost's (``"absolute"``), or the standard deviation of the costs
            that have a weight (``"relative"``).
    """

    native_name = "mppi"

    def __init__(
        self,
        cost: Any,
        batch_size: int = 1,
        num_samples: int = 300,
        var_scale: float = 1.0,
        n_steps: int = 30,
        topk: int | None = 30,
        temperature: float = 0.5,
        device: str | torch.device = "cpu",
        seed: int = 1234,
        callbacks: Sequence[Callback] | None = None,
        *,
        temperature_mode: str = "absolute",
        clip: bool = False,
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
        self.temperature = temperature
        self.temperature_mode = temperature_mode

    def settings(self) -> dict[str, Any]:
        # As the reference, whose `topk` may be more than there are samples: then all have a weight.
        elites = 0 if self.topk is None or self.topk >= self.num_samples else self.topk
        return {
            **super().settings(),
            "elites": elites,
            "temperature": float(self.temperature),
            "temperature_mode": self.temperature_mode,
        }
