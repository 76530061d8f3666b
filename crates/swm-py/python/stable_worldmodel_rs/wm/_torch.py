"""torch, for the modules of this folder; where it is not installed, the error says what needs it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

try:
    import torch as _torch
    import torch.nn.functional as _functional
    from torch import Tensor, nn
except ImportError as _error:
    raise ImportError("models in stable_worldmodel_rs.wm are torch modules, and torch is not installed; `pip install torch`") from _error

if TYPE_CHECKING:
    from torch import dtype as DType
else:
    DType = _torch.dtype

# Of any type: torch leaves those of many functions open.
torch: Any = _torch
F: Any = _functional

__all__ = ["DType", "F", "Tensor", "nn", "torch"]
