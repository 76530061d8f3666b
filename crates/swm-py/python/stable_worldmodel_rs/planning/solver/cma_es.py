"""CMA-ES."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._sampling import SamplingSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["CMAESSolver"]


class CMAESSolver(SamplingSolver):
    """An evolution strategy that adapts the covariance and the step size of its samples. Not in the reference.

    Args:
        cost, batch_size, device, seed, callbacks, clip, return_best: As of
            :class:`~stable_worldmodel_rs.planning.CEMSolver`.
        num_samples: Candidates per iteration, 4 or more; the cheaper half has weights.
        var_scale: Standard deviation in the first iteration.
        n_steps: Iterations. The defaults evaluate as many plans as those of ``CEMSolver``.
    """

    native_name = "cma-es"

    def __init__(
        self,
        cost: Any,
        batch_size: int = 1,
        num_samples: int = 50,
        var_scale: float = 1.0,
        n_steps: int = 180,
        device: str | torch.device = "cpu",
        seed: int = 1234,
        callbacks: Sequence[Callback] | None = None,
        *,
        clip: bool = False,
        return_best: bool = False,
    ) -> None:
        super().__init__(
            cost,
            batch_size,
            num_samples,
            var_scale,
            n_steps,
            num_samples // 2,
            device,
            seed,
            callbacks,
            clip=clip,
            return_best=return_best,
        )

    def settings(self) -> dict[str, Any]:
        settings = super().settings()
        del settings["elites"]
        return settings
