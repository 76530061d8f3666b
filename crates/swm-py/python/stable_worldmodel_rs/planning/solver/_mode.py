"""The mode of a cost that is a torch module: in training mode, some modules give other values at every call."""

from __future__ import annotations

import logging
from typing import Any

from ..._arrays import is_module

__all__ = ["note_training_mode"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")

# Classes of torch whose values depend on the mode begin so.
_DIFFERS = ("Dropout", "AlphaDropout", "FeatureAlphaDropout", "BatchNorm", "SyncBatchNorm", "LazyBatchNorm", "InstanceNorm", "RReLU")


def note_training_mode(cost: Any) -> None:
    """Warns of a cost, or of the models that it holds, whose modules are in training mode and give other values than in evaluation mode."""
    owned = [cost] if is_module(cost) else [one for one in getattr(cost, "__dict__", {}).values() if is_module(one)]
    differing = {type(one).__name__ for model in owned for one in model.modules() if one.training and type(one).__name__.startswith(_DIFFERS)}
    if differing:
        logger.warning(
            "%s plans in training mode, in which %s gives other costs at every call, so that results cannot be repeated; call eval() on the model",
            type(cost).__name__,
            ", ".join(sorted(differing)),
        )
