"""Goal-conditioned policies over the tokens of a frozen DINOv2: GCBC, GCIQL, GCIVL and HILP."""

from __future__ import annotations

from . import module
from .gcrl import GCRL

__all__ = ["GCRL", "module"]
