"""Arrays on their way to users: torch tensors where torch is installed, NumPy arrays elsewhere.

Nothing here imports torch before the first item of a dataset is read.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from collections.abc import Callable, Mapping
from functools import cache
from types import ModuleType
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from .._arrays import is_array

Output = Literal["torch", "numpy"] | None
"""What items and batches are made of; ``None``: torch if it is installed."""

Rewards = Literal["recorded", "action"]
"""Which rewards a clip holds: ``"recorded"``, row by row, each that of arriving at its row and NaN in an episode's first; or
``"action"``: beside every row, the sum of the rewards of the actions that are taken from it to the next row of the clip, as
many as ``action`` has there; NaN where the episode ends before. Datasets of other programs, and copies of them, hold each reward in
the row of its action, and are read so."""


def sums_rewards(rewards: Any) -> bool:
    """Whether rewards are those of actions.

    Raises:
        ValueError: It is neither of :data:`Rewards`.
    """
    if rewards not in ("recorded", "action"):
        raise ValueError(f"rewards={rewards!r}; use 'recorded' (row t: of arriving at t) or 'action' (row t: of what is done there)")
    return rewards == "action"


@cache
def torch_or_none() -> ModuleType | None:
    """torch, imported when it is first asked for; ``None`` where it is not installed."""
    if importlib.util.find_spec("torch") is None:
        return None
    return importlib.import_module("torch")


def require_torch(why: str) -> ModuleType:
    """torch, or an error that says what needs it."""
    torch = torch_or_none()
    if torch is None:
        raise ImportError(f"{why} needs torch; install it with `pip install torch`")
    return torch


def converter(output: Output = None) -> Callable[[Any], Any]:
    """The function that makes a tensor of an array (``output="torch"``) or leaves it (``"numpy"``)."""
    if output not in (None, "torch", "numpy"):
        raise ValueError(f"unknown output {output!r}; use 'torch', 'numpy' or None")
    torch = torch_or_none() if output is None else require_torch("output='torch'") if output == "torch" else None
    if torch is None:
        return _leave
    from_numpy = torch.from_numpy

    def convert(value: Any) -> Any:
        return from_numpy(value) if is_array(value) and value.dtype != object else value

    return convert


def _leave(value: Any) -> Any:
    return value


def to_numpy(value: Any) -> NDArray[Any]:
    """A tensor, list or array as an array; tensors come to the CPU first."""
    if hasattr(value, "detach"):
        tensor = value.detach().cpu()
        # NumPy has no bfloat16.
        value = (tensor.float() if str(tensor.dtype) == "torch.bfloat16" else tensor).numpy()
    return np.asarray(value)


def stack(values: list[Any]) -> Any:
    """Equal items of several clips as one batch item: tensors and arrays are stacked, text stays a list."""
    first: Any = values[0]
    if isinstance(first, np.ndarray):
        return np.stack(cast("list[NDArray[Any]]", values))  # pyright: ignore[reportUnknownVariableType]
    if isinstance(first, Mapping):
        return {key: stack([value[key] for value in values]) for key in first}  # pyright: ignore[reportUnknownVariableType]
    torch = torch_or_none()
    if torch is not None and isinstance(first, torch.Tensor):
        return torch.stack(values)
    if isinstance(first, (bool, int, float, np.number)):
        return torch.tensor(values) if torch is not None else np.asarray(values)
    return values


LOADED_IN = os.getpid()
"""The process in which this package was imported; forks of it have none of its threads."""


def may_use_threads() -> bool:
    """Whether reading may use several threads: not in forks and not in workers of a ``DataLoader``, which are many."""
    if os.getpid() != LOADED_IN:
        return False
    data = sys.modules.get("torch.utils.data")
    return data is None or data.get_worker_info() is None
