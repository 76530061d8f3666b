"""Recorders for solvers that follow gradients."""

from __future__ import annotations

from typing import Any

import numpy as np

from .common import Array, Callback, Reduction, array

__all__ = ["ActionNormRecorder", "GradNormRecorder"]


class GradNormRecorder(Callback):
    """Euclidean norm of the gradient of every row, mean over its sequences.

    Args:
        reduction: As of :class:`Callback`.
        per_step: One norm per block of the plan, a list of H, instead of one over all.
    """

    def __init__(self, reduction: Reduction = "mean", per_step: bool = False) -> None:
        super().__init__(reduction=reduction)
        self.per_step = per_step

    def compute(self, **state: Any) -> Any:
        params = state["params"]
        gradient = getattr(params, "grad", None)
        if gradient is None:
            return [0.0] * params.shape[2] if self.per_step else 0.0
        gradient = array(gradient)
        if self.per_step:
            norms = np.linalg.norm(gradient, axis=-1).mean(axis=1)
            return [self._reduce(norms[:, block]) for block in range(norms.shape[1])]
        return self._reduce(_norms(gradient))


class ActionNormRecorder(Callback):
    """Euclidean norm of the plans of every row, mean over its sequences."""

    def compute(self, **state: Any) -> float | list[float]:
        return self._reduce(_norms(array(state["params"])))


def _norms(values: Array) -> Array:
    """Of ``(b, S, H, D)``: ``(b,)``."""
    return np.linalg.norm(values.reshape(*values.shape[:2], -1), axis=-1).mean(axis=1)
