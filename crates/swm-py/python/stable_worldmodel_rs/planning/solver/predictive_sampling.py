"""Predictive sampling."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from ._base import BaseSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["PredictiveSamplingSolver"]


@dataclass(eq=False, repr=False)
class PredictiveSamplingSolver(BaseSolver):
    """Samples plans around the last one and takes the cheapest; nothing is fitted. It replans often.

    Source: Howell et al., *Predictive Sampling: Real-time Behavior Synthesis with MuJoCo* (2022).

    Args:
        n_steps: Rounds of sampling and choosing; the reference makes one.

    ``costs`` of the result are those of the plans themselves.
    """

    native_name = "predictive-sampling"
    _asks_actor = False
    topk: ClassVar[int] = 1

    cost: Any
    batch_size: int | None = 1
    num_samples: int = 300
    noise_scale: float = 1.0
    device: str | torch.device = "cpu"
    seed: int = 1234
    _: KW_ONLY
    n_steps: int = 1
    callbacks: Sequence[Callback] | None = None
    clip: bool = False

    @property
    def var_scale(self) -> float:
        """The same as ``noise_scale``, under the name of other solvers."""
        return self.noise_scale

    def init_nominal(self, n_envs: int, actions: torch.Tensor | None = None) -> torch.Tensor:
        """The plan that the search begins at, ``(n_envs, H, D)``: ``actions``, ``(n_envs, t, D)``, then zeros."""
        return self._continued(n_envs, actions)
