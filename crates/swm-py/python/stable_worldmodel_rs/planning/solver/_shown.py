"""What becomes of a solver's iterations: they are shown to its callbacks; of the first, the candidates can be kept."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..._arrays import Array

if TYPE_CHECKING:
    from ._base import BaseSolver

__all__ = ["FirstCandidates", "Params", "Shown"]


class Shown:
    """Shows the iterations of a chunk to the callbacks of its solver."""

    def __init__(self, solver: BaseSolver, initial: Array) -> None:
        self._of = solver
        self._mean = initial
        self._std: Array | None = None

    def __call__(
        self,
        step: int,
        candidates: Array,
        costs: Array,
        mean: Array | None,
        std: Array | None,
        gradient: Array | None,
    ) -> None:
        make = self._of.as_given
        state: dict[str, Any] = {"step": step, "costs": make(costs)}
        if mean is None or std is None:
            params = make(candidates)
            if gradient is not None:
                params = params.view(Params) if isinstance(params, np.ndarray) else params
                params.grad = make(gradient)
            state |= {"params": params, "cost": state["costs"].sum()}
        else:
            kept = min(getattr(self._of, "topk", 1) or costs.shape[1], costs.shape[1])
            order = np.argsort(costs, axis=1, kind="stable")[:, :kept]
            rows = np.arange(len(costs))[:, None]
            before = np.full_like(std, getattr(self._of, "var_scale", 1.0)) if self._std is None else self._std
            state |= {
                "candidates": make(candidates),
                "topk_vals": make(costs[rows, order]),
                "topk_inds": make(order),
                "topk_candidates": make(candidates[rows, order]),
                "mean": make(mean),
                "var": make(std),
                "prev_mean": make(self._mean),
                "prev_var": make(before),
            }
            self._mean, self._std = mean, std
        self._of.show(state)


class Params(np.ndarray[Any, Any]):  # A view of candidates.
    """An array with a gradient, as callbacks of gradient solvers expect."""

    grad: Array | None = None


class FirstCandidates:
    """A bridge that keeps the first candidates, and calls every plan equally good."""

    candidates: Array

    def evaluate(self, candidates: Array) -> Array:
        if not hasattr(self, "candidates"):
            self.candidates = candidates
        return np.zeros(candidates.shape[:2])

    def differentiate(self, candidates: Array) -> tuple[Array, Array]:
        return self.evaluate(candidates), np.zeros_like(candidates)
