"""Recorders of what a solver does in every iteration: ``CEMSolver(cost, callbacks=[BestCostRecorder()])``.

``solve`` returns their histories under ``callbacks``: a list per chunk of rows, with an entry per iteration.
"""

from .cem import EliteCostRecorder, EliteSpreadRecorder, MeanShiftRecorder, VarNormRecorder
from .common import BestCostRecorder, Callback, MeanCostRecorder
from .gd import ActionNormRecorder, GradNormRecorder

__all__ = [
    "ActionNormRecorder",
    "BestCostRecorder",
    "Callback",
    "EliteCostRecorder",
    "EliteSpreadRecorder",
    "GradNormRecorder",
    "MeanCostRecorder",
    "MeanShiftRecorder",
    "VarNormRecorder",
]
