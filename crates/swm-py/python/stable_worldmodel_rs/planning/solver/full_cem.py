"""The cross-entropy method with a full covariance."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from .cem import CEMSolver

__all__ = ["FullCEMSolver"]


@dataclass(eq=False, repr=False)
class FullCEMSolver(CEMSolver):
    """As :class:`CEMSolver`, but fits how the values of cheap plans vary together. Not in the reference.

    Args:
        shrinkage: Weight of the diagonal in the covariance, 0 to 1; more is better with few elites.
    """

    native_name = "full-cem"

    _: KW_ONLY
    shrinkage: float = 0.1
    alpha: float = 0.2
