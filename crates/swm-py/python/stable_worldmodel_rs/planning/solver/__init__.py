"""The solvers. Each searches in Rust for the plan of lowest cost; the cost is a Python object."""

from ._documentation import document as _document
from .categorical_cem import CategoricalCEMSolver
from .cem import CEMSolver
from .cma_es import CMAESSolver
from .full_cem import FullCEMSolver
from .gd import GradientSolver
from .icem import ICEMSolver
from .lagrangian import LagrangianSolver
from .mppi import MPPISolver
from .pgd import PGDSolver
from .predictive_sampling import PredictiveSamplingSolver
from .solver import Solver

__all__ = [
    "CEMSolver",
    "CMAESSolver",
    "CategoricalCEMSolver",
    "FullCEMSolver",
    "GradientSolver",
    "ICEMSolver",
    "LagrangianSolver",
    "MPPISolver",
    "PGDSolver",
    "PredictiveSamplingSolver",
    "Solver",
]

for _name in __all__:
    if _name != "Solver":
        _solver = globals()[_name]
        _document(_solver, _solver.native_name if isinstance(_solver.native_name, str) else "sgd")
