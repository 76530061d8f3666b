"""LeWM: a joint-embedding world model that a test of normality keeps from collapsing (arXiv 2603.19312)."""

from __future__ import annotations

from . import module
from .lewm import LeWM

__all__ = ["LeWM", "module"]
