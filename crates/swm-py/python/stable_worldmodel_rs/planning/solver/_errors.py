"""The exception for costs and inputs that a solver cannot work with."""

from __future__ import annotations

from ..._swm import PlanError

__all__ = ["PlanAssertionError"]


class PlanAssertionError(PlanError, AssertionError):
    """A cost, an action space or a plan does not fit the solver.

    It is an ``AssertionError`` as well, which is what the reference raises in these places.
    """
