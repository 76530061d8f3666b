"""Recorders for solvers that sample."""

from __future__ import annotations

from typing import Any

import numpy as np

from .common import Callback, array

__all__ = ["EliteCostRecorder", "EliteSpreadRecorder", "MeanShiftRecorder", "VarNormRecorder"]


class EliteCostRecorder(Callback):
    """Mean, lowest and highest cost of every row's elites: a dict of three."""

    def compute(self, **state: Any) -> dict[str, float | list[float]]:
        costs = array(state["topk_vals"])
        return {
            "mean": self._reduce(costs.mean(axis=1)),
            "min": self._reduce(costs.min(axis=1)),
            "max": self._reduce(costs.max(axis=1)),
        }


class VarNormRecorder(Callback):
    """Mean standard deviation of every row's search distribution."""

    def compute(self, **state: Any) -> float | list[float]:
        std = array(state["var"])
        return self._reduce(std.reshape(len(std), -1).mean(axis=1))


class MeanShiftRecorder(Callback):
    """How far the mean of every row's search distribution moved: a Euclidean distance over H and D."""

    def compute(self, **state: Any) -> float | list[float] | None:
        if state.get("prev_mean") is None:
            return None
        shift = array(state["mean"]) - array(state["prev_mean"])
        return self._reduce(np.linalg.norm(shift.reshape(len(shift), -1), axis=1))


class EliteSpreadRecorder(Callback):
    """Standard deviation within every row's elites, mean over H and D."""

    def compute(self, **state: Any) -> float | list[float]:
        std = array(state["topk_candidates"]).std(axis=1, ddof=1)
        return self._reduce(std.reshape(len(std), -1).mean(axis=1))
