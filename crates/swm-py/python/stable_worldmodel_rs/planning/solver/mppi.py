"""MPPI: model-predictive path integral control."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any

from ._sampling import SamplingSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["MPPISolver"]


@dataclass(eq=False, repr=False)
class MPPISolver(SamplingSolver):
    """The plan is the mean of its samples, weighted by a softmax of minus their costs; their std is fixed.

    Source: Williams et al., *Information-Theoretic Model Predictive Control* (2018).

    Args:
        topk: Cheapest candidates that have a weight; None: all.
        temperature_mode: Unit of the temperature: the cost's (``"absolute"``), or the standard deviation of the costs
            that have a weight (``"relative"``).
    """

    native_name = "mppi"

    cost: Any
    batch_size: int | None = 1
    num_samples: int = 300
    var_scale: float = 1.0
    n_steps: int = 30
    topk: int | None = 30
    temperature: float = 0.5
    device: str | torch.device = "cpu"
    seed: int = 1234
    callbacks: Sequence[Callback] | None = None
    _: KW_ONLY
    temperature_mode: str = "absolute"
    clip: bool = False
    return_best: bool = False

    def settings(self) -> dict[str, Any]:
        # As the reference, whose `topk` may be more than there are samples: then all have a weight.
        return super().settings() | {"elites": 0 if self.topk is None or self.topk >= self.num_samples else self.topk}
