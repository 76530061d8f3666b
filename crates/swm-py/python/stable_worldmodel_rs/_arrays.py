"""Arrays that may be NumPy's or torch's, without importing torch."""

from __future__ import annotations

import sys
from typing import Any

__all__ = ["is_tensor", "require_torch"]


def is_tensor(value: object) -> bool:
    """Whether ``value`` is a torch tensor. Where torch was never imported, nothing is."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, torch.Tensor)


def require_torch(what: str) -> Any:
    """The module ``torch``; an error that says what ``what`` needs it for."""
    try:
        import torch
    except ImportError as error:
        raise ImportError(f"{what}, and torch is not installed; `pip install torch`") from error
    return torch
