"""Arrays that may be NumPy's or torch's, without importing torch."""

from __future__ import annotations

import operator
import sys
from typing import Any, TypeGuard

import numpy as np
import numpy.typing as npt

__all__ = ["Array", "image_sides", "is_array", "is_module", "is_tensor", "require_torch"]

Array = npt.NDArray[Any]
"""An array of any type; shapes are in the docs."""


def image_sides(name: str, value: Any) -> tuple[int, int]:
    """The height and width of images, given as the argument ``name``.

    Raises:
        TypeError: It is no pair of whole numbers.
        ValueError: One of them is negative.
    """
    try:
        height, width = (operator.index(length) for length in value)
    except (TypeError, ValueError):
        raise TypeError(
            f"{name}={value!r}: give the height and width of the images, such as {name}=(64, 64)"
        ) from None
    if min(height, width) < 0:
        raise ValueError(f"{name}={value!r}: give sides of 1 pixel or more")
    return height, width


def is_array(value: object) -> TypeGuard[Array]:
    """Whether ``value`` is a NumPy array."""
    return isinstance(value, np.ndarray)


def is_tensor(value: object) -> TypeGuard[Any]:
    """Whether ``value`` is a torch tensor. Where torch was never imported, nothing is."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, torch.Tensor)


def is_module(value: object) -> TypeGuard[Any]:
    """Whether ``value`` is a torch module. Where torch was never imported, nothing is."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, torch.nn.Module)


def require_torch(what: str) -> Any:
    """The module ``torch``; an error that says what ``what`` needs it for."""
    try:
        import torch
    except ImportError as error:
        raise ImportError(f"{what}, and torch is not installed; `pip install torch`") from error
    return torch
