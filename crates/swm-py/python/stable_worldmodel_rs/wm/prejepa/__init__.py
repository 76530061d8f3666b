"""PreJEPA, the reference's DINO-WM: a world model over the tokens of a frozen DINOv2 (arXiv 2411.04983)."""

from __future__ import annotations

from . import module
from .prejepa import PreJEPA

__all__ = ["PreJEPA", "module"]
