"""CMA-ES."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any

from ._sampling import SamplingSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["CMAESSolver"]


@dataclass(eq=False, repr=False)
class CMAESSolver(SamplingSolver):
    """An evolution strategy that adapts the covariance and the step size of its samples. Not in the reference.

    Args:
        num_samples: Candidates per iteration, 4 or more; the cheaper half has weights.
        n_steps: Iterations. The defaults evaluate as many plans as those of ``CEMSolver``.
    """

    native_name = "cma-es"

    cost: Any
    batch_size: int | None = 1
    num_samples: int = 50
    var_scale: float = 1.0
    n_steps: int = 180
    device: str | torch.device = "cpu"
    seed: int = 1234
    callbacks: Sequence[Callback] | None = None
    _: KW_ONLY
    clip: bool = False
    return_best: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self.topk: int = self.num_samples // 2  # For callbacks.
