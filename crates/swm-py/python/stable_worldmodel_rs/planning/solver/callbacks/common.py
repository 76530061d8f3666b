"""The base of callbacks, and recorders for any solver."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from ...._arrays import Array

__all__ = ["Array", "BestCostRecorder", "Callback", "MeanCostRecorder", "Reduction", "array"]

Reduction = Literal["mean", "sum", "none"]


def array(values: Any) -> Array:
    """An array of a tensor of any device and floating type; arrays as they are."""
    return values.detach().float().cpu().numpy() if hasattr(values, "detach") else np.asarray(values)


class Callback:
    """Records a value in every iteration. A subclass writes ``compute``.

    Args:
        reduction: What becomes of a value per row: their ``"mean"``, their ``"sum"``, or ``"none"``, a list.

    Sampling solvers call it with ``step``, ``candidates (b, S, H, D)``, ``costs (b, S)``, ``topk_vals (b, K)``,
    ``topk_inds (b, K)``, ``topk_candidates (b, K, H, D)``, and ``mean``, ``var``, ``prev_mean``, ``prev_var``
    ``(b, H, D)``, where ``var`` is a standard deviation. ``CategoricalCEMSolver`` gives ``probs`` and ``prev_probs``
    ``(b, H, action_block, K)`` instead of these four. Gradient solvers give ``step``, ``params (b, S, H, D)`` with
    their gradient ``params.grad``, ``costs`` and their sum ``cost``. All are tensors on the CPU, or arrays for a
    NumPy cost; they are copies, which may be kept.

    Example:
        >>> class WorstCost(Callback):
        ...     def compute(self, **state):
        ...         return float(state["costs"].max())
    """

    name: str | None = None
    """The key of the history in the result; None: the name of the class."""

    def __init__(self, reduction: Reduction = "mean") -> None:
        if reduction not in ("mean", "sum", "none"):
            raise ValueError(f"reduction must be 'mean', 'sum', or 'none', got {reduction!r}")
        self.reduction = reduction
        self.history: list[list[Any]] = []
        self._current: list[Any] = []

    def _reduce(self, values: Any) -> float | list[float]:
        """The reduction of a value per row."""
        values = array(values)
        if self.reduction == "mean":
            return float(values.mean())
        if self.reduction == "sum":
            return float(values.sum())
        return values.tolist()

    def reset(self) -> None:
        """A solve begins: forgets everything."""
        self.history = []
        self._current = []

    def start_batch(self) -> None:
        """A chunk of rows begins."""
        self.end_solve()

    def end_solve(self) -> None:
        """A solve is over."""
        if self._current:
            self.history.append(self._current)
        self._current = []

    def __call__(self, **state: Any) -> None:
        """One iteration is over."""
        value = self.compute(**state)
        if value is not None:
            self._current.append(value)

    def compute(self, **state: Any) -> Any:
        """The value of an iteration; None records nothing."""
        raise NotImplementedError

    @property
    def output_key(self) -> str:
        """The key of the history in the result of ``solve``."""
        return self.name or type(self).__name__


class BestCostRecorder(Callback):
    """The lowest cost of every row."""

    def compute(self, **state: Any) -> float | list[float]:
        return self._reduce(array(state["costs"]).min(axis=1))


class MeanCostRecorder(Callback):
    """The mean cost of every row's candidates."""

    def compute(self, **state: Any) -> float | list[float]:
        return self._reduce(array(state["costs"]).mean(axis=1))
