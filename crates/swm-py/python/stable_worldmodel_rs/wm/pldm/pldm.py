"""PLDM: a joint-embedding world model that variances and covariances keep from collapsing (arXiv 2502.14819)."""

from __future__ import annotations

from .._joint import JointModel

__all__ = ["PLDM"]


class PLDM(JointModel):
    """The model. What is learned, and how, is in :mod:`stable_worldmodel_rs.wm.loss`."""
