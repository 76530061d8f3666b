"""The cross-entropy method for integers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..._arrays import Array
from ._base import BaseSolver, torch_of
from ._bridge import Bridge
from ._errors import PlanAssertionError
from ._space import PlanSpace

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["CategoricalCEMSolver"]


class CategoricalCEMSolver(BaseSolver):
    """Samples plans of integers from independent categories and refits their probabilities to the cheapest ones.

    The cost is given one-hot candidates ``(b, S, H, action_block × K)`` for K categories.

    Args:
        cost, batch_size, num_samples, n_steps, topk, device, seed, callbacks, return_best: As of
            :class:`~stable_worldmodel_rs.planning.CEMSolver`.
        smoothing: Added to every category's frequency among the elites; above 0, no category dies out.
        alpha: Momentum: weight of the old probabilities in the new ones.
        warm_start_epsilon: Probability that a warm-started action is sampled uniformly; 1, as in the reference, ignores
            the warm start.

    ``solve`` returns ``actions``, the most probable plan, ``(B, H, action_block × A)`` int64; ``costs``, the mean cost of
    the last elites; ``probs``, a list of one ``(B, H, action_block, K)``.
    """

    native_name = "categorical-cem"
    _asks_actor = False

    def __init__(
        self,
        cost: Any,
        batch_size: int = 1,
        num_samples: int = 300,
        n_steps: int = 30,
        topk: int = 30,
        smoothing: float = 0.0,
        alpha: float = 0.0,
        device: str | torch.device = "cpu",
        seed: int = 1234,
        callbacks: Sequence[Callback] | None = None,
        *,
        warm_start_epsilon: float = 1.0,
        return_best: bool = False,
    ) -> None:
        super().__init__(cost, batch_size, num_samples, device, seed, callbacks)
        self.n_steps = n_steps
        self.topk = topk
        self.smoothing = smoothing
        self.alpha = alpha
        self.warm_start_epsilon = warm_start_epsilon
        self.return_best = return_best

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

    def settings(self) -> dict[str, Any]:
        return {
            "samples": self.num_samples,
            "iterations": self.n_steps,
            "elites": self.topk,
            "smoothing": float(self.smoothing),
            "alpha": float(self.alpha),
            "warm_start_epsilon": float(self.warm_start_epsilon),
            "return_best": self.return_best,
        }

    def _evaluations(self) -> int:
        return self.n_steps

    def init_probs(self, n_envs: int) -> torch.Tensor:
        """The probabilities that the search begins with: uniform, ``(n_envs, H, action_block, K)``."""
        torch = torch_of(self.cost)
        space = self._require_configured()
        even = torch.cat([torch.full((count,), 1.0 / count) for count in space.categories])
        return even.to(device=self.device, dtype=self.dtype).repeat(n_envs, self.horizon, self.action_block, 1)

    def _given(self, init_action: Any) -> Array:
        values = init_action.cpu().numpy() if hasattr(init_action, "cpu") else np.asarray(init_action)
        if np.issubdtype(values.dtype, np.integer):
            return self._require_configured().one_hot(values)
        return np.asarray(values, np.float32)

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
        costs = "cost" if self.return_best else "elite_mean"
        probs = np.concatenate([result["mean"] for result in results])
        probs = probs.reshape(len(probs), self.horizon, self.action_block, self.base_simplex_dim)
        return {
            "costs": np.concatenate([result[costs] for result in results]).tolist(),
            "probs": [self.as_given(probs)],
        }
