"""Worlds: environments stepped together, and what their runs come to."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .env_pool import EnvPool
    from .ids import env_ids, native_id
    from .native import NativePool
    from .policies import NativePolicy
    from .results import EvaluationResult
    from .world import World

__all__ = ["EnvPool", "EvaluationResult", "NativePolicy", "NativePool", "World", "env_ids", "native_id"]

# Loaded when first used: not every part of the package needs a World.
_HOMES = {
    "EnvPool": "env_pool",
    "EvaluationResult": "results",
    "NativePolicy": "policies",
    "NativePool": "native",
    "World": "world",
    "env_ids": "ids",
    "native_id": "ids",
}


if not TYPE_CHECKING:
    # Type checkers would take any name for granted.
    def __getattr__(name: str) -> object:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
        globals()[name] = value
        return value
