"""LeWM: a joint-embedding world model that a test of normality keeps from collapsing (arXiv 2603.19312)."""

from __future__ import annotations

from .._joint import JointModel

__all__ = ["LeWM"]


class LeWM(JointModel):
    """The model. What is learned, and how, is in :mod:`stable_worldmodel_rs.wm.loss`."""
