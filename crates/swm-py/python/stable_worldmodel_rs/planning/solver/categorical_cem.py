"""The cross-entropy method for integers."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._arrays import Array
from ._base import BaseSolver, joined, torch_of
from ._bridge import Bridge
from ._errors import PlanAssertionError
from ._space import PlanSpace

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["CategoricalCEMSolver"]


@dataclass(eq=False, repr=False)
class CategoricalCEMSolver(BaseSolver):
    """Samples plans of integers from independent categories and refits their probabilities to the cheapest ones.

    The cost is given one-hot candidates ``(b, S, H, action_block × K)`` for K categories.

    Args:
        warm_start_epsilon: Probability that a warm-started action is sampled uniformly; 1, as in the reference, ignores
            the warm start.

    ``solve`` returns ``actions``, the most probable plan, ``(B, H, action_block × A)`` int64; ``costs``, the mean cost of
    the last elites; ``probs``, a list of one ``(B, H, action_block, K)``.
    """

    native_name = "categorical-cem"
    _asks_actor = False

    cost: Any
    batch_size: int | None = 1
    num_samples: int = 300
    n_steps: int = 30
    topk: int = 30
    smoothing: float = 0.0
    alpha: float = 0.0
    device: str | torch.device = "cpu"
    seed: int = 1234
    callbacks: Sequence[Callback] | None = None
    _: KW_ONLY
    warm_start_epsilon: float = 1.0
    return_best: bool = False

    def _check_space(self, space: PlanSpace) -> None:
        if not space.categories:
            raise PlanAssertionError(
                f"CategoricalCEMSolver plans integers, and the action space is {self._action_space}; use CEMSolver for "
                "real numbers"
            )

    @property
    def base_simplex_dim(self) -> int:
        """K: categories of an action, all of its integers together."""
        return self._require_configured().values

    @property
    def action_simplex_dim(self) -> int:
        """Values of a block of one-hot actions."""
        return self.base_simplex_dim * self.action_block

    @property
    def action_dim(self) -> int:
        """K, as in the reference."""
        return self.base_simplex_dim

    @property
    def action_block(self) -> int:
        """Actions of a block."""
        return self._config.action_block

    def init_probs(self, n_envs: int) -> torch.Tensor:
        """The probabilities that the search begins with: uniform, ``(n_envs, H, action_block, K)``."""
        torch = torch_of(self.cost)
        space = self._require_configured()
        even = torch.cat([torch.full((count,), 1.0 / count) for count in space.categories])
        return even.to(device=self.device, dtype=self.dtype).repeat(n_envs, self.horizon, self.action_block, 1)

    def show(self, state: dict[str, Any]) -> None:
        shape = (self.horizon, self.action_block, self.base_simplex_dim)
        kept = {name: state[name] for name in ("step", "candidates", "costs", "topk_vals", "topk_inds")}
        elites = state["topk_candidates"]
        kept["topk_candidates"] = elites.reshape(*elites.shape[:2], *shape)
        for name, source in (("probs", "mean"), ("prev_probs", "prev_mean")):
            kept[name] = state[source].reshape(-1, *shape)
        if kept["step"] == 0 and self.warm_start_epsilon == 1.0:
            # The search begins at zeros, which stand for equal probabilities.
            kept["prev_probs"] = self.as_given(self._uniform(kept["probs"].shape))
        super().show(kept)

    def _uniform(self, shape: tuple[int, ...]) -> Array:
        even = [np.full(count, 1.0 / count, np.float32) for count in self._require_configured().categories]
        return np.broadcast_to(np.concatenate(even), shape).copy()

    def _finish(self, results: list[dict[str, Any]], bridges: list[Bridge]) -> dict[str, Any]:
        probs = joined(results, "mean")
        probs = probs.reshape(len(probs), self.horizon, self.action_block, self.base_simplex_dim)
        return super()._finish(results, bridges) | {"probs": [self.as_given(probs)]}
