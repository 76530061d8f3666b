"""PLDM: a joint-embedding world model that variances and covariances keep from collapsing (arXiv 2502.14819)."""

from __future__ import annotations

from . import module
from .pldm import PLDM

__all__ = ["PLDM", "module"]
