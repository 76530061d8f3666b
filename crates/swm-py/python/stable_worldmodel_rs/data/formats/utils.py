"""What formats have in common."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["is_image_column"]


def is_image_column(vals: Any) -> bool:
    """Whether the values of a column are images: uint8 of shape ``(H, W, 1)`` or ``(H, W, 3)`` per step."""
    if vals is None or len(vals) == 0:
        return False
    first = np.asarray(vals[0])
    return first.dtype == np.uint8 and first.ndim == 3 and first.shape[-1] in (1, 3)
