"""The cross-entropy method with a full covariance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .cem import CEMSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["FullCEMSolver"]


class FullCEMSolver(CEMSolver):
    """As :class:`CEMSolver`, but fits how the values of cheap plans vary together. Not in the reference.

    Args:
        cost, batch_size, num_samples, var_scale, n_steps, topk, device, seed, callbacks, clip, sigma_min, return_best:
            As of :class:`CEMSolver`.
        shrinkage: Weight of the diagonal in the covariance, 0 to 1; more is better with few elites.
        alpha: Momentum: weight of the old covariance in the new one.
    """

    native_name = "full-cem"

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
        shrinkage: float = 0.1,
        alpha: float = 0.2,
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
            sigma_min=sigma_min,
            return_best=return_best,
        )
        self.shrinkage = shrinkage
        self.alpha = alpha

    def settings(self) -> dict[str, Any]:
        return {**super().settings(), "shrinkage": float(self.shrinkage), "alpha": float(self.alpha)}
