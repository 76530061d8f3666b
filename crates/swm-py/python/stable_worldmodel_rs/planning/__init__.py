"""Planning: solvers, costs of world models, and the objectives that rate their rollouts.

Solvers need no torch; :class:`ShootingCostEvaluator` and the objectives are torch modules, and import it.
"""

from __future__ import annotations

from importlib import import_module as _import_module
from typing import TYPE_CHECKING

from ..protocols import Constrainable, Costable, Dynamics, Objective
from .mpc import MpcPolicy, SimulatorCost
from .solver import (
    CategoricalCEMSolver,
    CEMSolver,
    CMAESSolver,
    FullCEMSolver,
    GradientSolver,
    ICEMSolver,
    LagrangianSolver,
    MPPISolver,
    PGDSolver,
    PredictiveSamplingSolver,
    Solver,
)

if TYPE_CHECKING:
    from .evaluator import ShootingCostEvaluator, default_goal_encode, flat_goal_encode, split_goal_encode
    from .objective import ControlPenalty, GoalMSE, WeightedSum

# Names of modules that need torch, loaded when they are first used.
_HOMES = {
    "ControlPenalty": "objective",
    "GoalMSE": "objective",
    "WeightedSum": "objective",
    "ShootingCostEvaluator": "evaluator",
    "default_goal_encode": "evaluator",
    "flat_goal_encode": "evaluator",
    "split_goal_encode": "evaluator",
}

__all__ = [
    "CEMSolver",
    "CMAESSolver",
    "CategoricalCEMSolver",
    "Constrainable",
    "ControlPenalty",
    "Costable",
    "Dynamics",
    "FullCEMSolver",
    "GoalMSE",
    "GradientSolver",
    "ICEMSolver",
    "LagrangianSolver",
    "MPPISolver",
    "MpcPolicy",
    "Objective",
    "PGDSolver",
    "PredictiveSamplingSolver",
    "ShootingCostEvaluator",
    "SimulatorCost",
    "Solver",
    "WeightedSum",
    "default_goal_encode",
    "flat_goal_encode",
    "split_goal_encode",
]


if not TYPE_CHECKING:
    # Type checkers would take any name for granted.
    def __getattr__(name: str) -> object:
        if name in _HOMES:
            value = getattr(_import_module(f".{_HOMES[name]}", __name__), name)
            globals()[name] = value
            return value
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
