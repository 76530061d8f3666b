"""Columns and images as models want them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

import numpy as np

from ._arrays import Array, is_array, is_tensor, require_torch

__all__ = ["note_unused", "scale", "transform"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")


def note_unused(settings: Mapping[str, Mapping[str, Any]], infos: Mapping[str, Any]) -> None:
    """Notes the scalings and transforms that no column has: a misspelled one would do nothing, silently."""
    for name, of_columns in settings.items():
        unused = [column for column in of_columns if column not in infos and column != "action"]
        if unused:
            columns = ", ".join(column for column in infos if not column.startswith("_"))
            logger.info("%s of %s has no effect; the columns are %s", name, ", ".join(unused), columns)


def scale(scaler: Any, key: str, values: Any) -> Array:
    """Values ``(..., D)`` scaled row by row; blocks of several actions action by action."""
    if not hasattr(scaler, "transform"):
        raise TypeError(
            f"process['{key}'] is {scaler!r}; give an object with transform and inverse_transform, such as a StandardScaler"
        )
    if not is_array(values):
        raise ValueError(
            f"Expected numpy array for key '{key}' in process, got {type(values)}; leave tensors out of process"
        )
    dim = getattr(scaler, "n_features_in_", None)
    if dim is not None and values.ndim > 1 and values.shape[-1] != dim and values.shape[-1] % dim == 0:
        rows = values.reshape(-1, dim)
    else:
        rows = values.reshape(-1, *values.shape[2:]) if values.ndim > 2 else values
    return np.asarray(scaler.transform(rows)).reshape(values.shape)


def transform(function: Callable[[Any], Any], key: str, values: Any) -> Any:
    """A transform applied to every image of ``(N, T, H, W, C)``: ``(N, T, C, H, W)``, or what it makes of them."""
    leading = values.shape[:2] if values.ndim > 2 else values.shape[:1]
    flat = values.reshape(-1, *values.shape[len(leading) :])
    if key.startswith(("pixels", "goal")) and flat.ndim == 4:
        flat = flat.permute(0, 3, 1, 2) if is_tensor(flat) else np.ascontiguousarray(flat.transpose(0, 3, 1, 2))
    torch = require_torch("transforms of images take torch tensors")
    images = flat if is_tensor(flat) else torch.from_numpy(flat)
    try:
        as_image: Any = import_module("torchvision.tv_tensors").Image
    except ImportError:  # Transforms of torchvision know a tensor for an image, too.
        as_image = torch.as_tensor
    made = [function(as_image(image)) for image in images]
    stacked = torch.stack([torch.as_tensor(image) for image in made])
    return stacked.reshape(*leading, *stacked.shape[1:])
