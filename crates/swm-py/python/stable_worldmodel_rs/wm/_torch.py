"""torch, for the modules of this folder; where it is not installed, the error says what needs it."""

from __future__ import annotations

try:
    import torch
    import torch.nn.functional as F
    from torch import Tensor, nn
except ImportError as _error:
    raise ImportError("models in stable_worldmodel_rs.wm are torch modules, and torch is not installed; `pip install torch`") from _error

__all__ = ["F", "Tensor", "nn", "torch"]
