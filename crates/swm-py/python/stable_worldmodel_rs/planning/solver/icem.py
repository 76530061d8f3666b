"""iCEM: the cross-entropy method with colored noise, kept elites and momentum."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any

from ._base import torch_of
from ._sampling import SamplingSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import gymnasium as gym
    import torch

    from .callbacks import Callback

__all__ = ["ICEMSolver"]


@dataclass(eq=False, repr=False)
class ICEMSolver(SamplingSolver):
    """CEM with noise that is correlated in time, elites that are candidates again, and momentum; clips to the bounds.

    Source: Pinneri et al., *Sample-efficient Cross-Entropy Method for Real-time Planning* (2020).

    Args:
        n_elite_keep: Elites that are candidates again in the next iteration.
        return_mean: Return the final mean; False returns the cheapest candidate of all iterations.
        decay: Factor by which candidates become fewer, down to twice ``topk`` (1.25 as published).
        elite_shift: Blocks between two plans of an episode, to start from the last plan's elites; 0 does not.
    """

    native_name = "icem"

    cost: Any
    batch_size: int | None = 1
    num_samples: int = 300
    var_scale: float = 1.0
    n_steps: int = 30
    topk: int = 30
    noise_beta: float = 2.0
    alpha: float = 0.1
    n_elite_keep: int = 5
    return_mean: bool = True
    device: str | torch.device = "cpu"
    seed: int = 1234
    callbacks: Sequence[Callback] | None = None
    _: KW_ONLY
    clip: bool = True
    sigma_min: float = 0.0
    decay: float = 1.0
    elite_shift: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._action_low: torch.Tensor | None = None
        self._action_high: torch.Tensor | None = None

    def settings(self) -> dict[str, Any]:
        return super().settings() | {"return_best": not self.return_mean}

    def configure(self, *, action_space: gym.Space[Any], n_envs: int, config: Any) -> None:
        super().configure(action_space=action_space, n_envs=n_envs, config=config)
        space, block = self._require_configured(), config.action_block
        if self.array_api == "torch" and not space.categories:
            torch = torch_of(self.cost)
            place = {"device": self.device, "dtype": self.dtype}
            self._action_low = torch.tensor(space.low, **place).repeat(block)
            self._action_high = torch.tensor(space.high, **place).repeat(block)

    def show(self, state: dict[str, Any]) -> None:
        super().show({**state, "action_low": self._action_low, "action_high": self._action_high})
