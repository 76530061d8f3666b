"""The recent past of several environments, for policies whose model wants more than one frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ._arrays import is_tensor

__all__ = ["HistoryBuffer"]


class HistoryBuffer:
    """A ring of the last infos of every environment.

    Frames are ``action_block`` steps apart, counted back from the newest. An environment that is younger than what is
    asked for is padded on the left with copies of its oldest frame, and with blocks of zeros between them, so that all
    histories have one length; :meth:`num_strided` says how many frames are real.

    Args:
        n_envs: How many environments there are.
        max_len: Steps that are kept of each.
        action_block: Steps from one frame to the next.
        block_keys: Keys (usually ``("action",)``) of which all steps between two frames are wanted, in one row: of n
            frames there are n - 1 rows, ``(n_envs, n - 1, action_block × D)``. A step's action is the one that led to
            it; NaN, which stands at a reset, becomes 0.

    Example:
        >>> buffer = HistoryBuffer(n_envs=1, max_len=5, action_block=2)
        >>> for step in range(5):
        ...     buffer.append({"state": np.full((1, 1, 3), step)})
        >>> buffer.get(3)["state"][0, :, 0]
        array([0, 2, 4])
    """

    def __init__(
        self, n_envs: int, max_len: int, action_block: int = 1, block_keys: Iterable[str] = ()
    ) -> None:
        for name, value in (("n_envs", n_envs), ("max_len", max_len), ("action_block", action_block)):
            if value <= 0:
                raise ValueError(f"{name} must be positive, got {value}")
        self.n_envs = n_envs
        self.max_len = max_len
        self.action_block = action_block
        self.block_keys: frozenset[str] = frozenset(block_keys)
        self._buffers: list[deque[dict[str, Any]]] = [deque(maxlen=max_len) for _ in range(n_envs)]

    def append(self, info_dict: dict[str, Any]) -> None:
        """Stores a copy of a step: arrays and tensors ``(n_envs, ...)``. A World writes to its own again."""
        for index, buffer in enumerate(self._buffers):
            buffer.append({key: _slice_env(value, index) for key, value in info_dict.items()})

    def get(self, n: int, env_ids: Sequence[int] | None = None) -> dict[str, Any] | None:
        """The last n frames, oldest first, of the environments ``env_ids`` (None: all).

        Returns:
            Per key ``(len(env_ids), n × T, ...)`` for steps ``(n_envs, T, ...)``, and ``(len(env_ids), n)`` for steps
            ``(n_envs,)``; keys of ``block_keys`` are left out for n = 1. None for n below 1, and where one of the
            environments has no step yet.
        """
        chosen = self._buffers if env_ids is None else [self._buffers[index] for index in env_ids]
        if n <= 0 or not all(chosen):
            return None
        history: dict[str, Any] = {}
        for key in chosen[0][-1]:
            if key not in self.block_keys:
                history[key] = _stack_envs([self._frames(buffer, key, n) for buffer in chosen])
            elif n > 1:
                history[key] = _stack_envs([self._blocks(buffer, key, n) for buffer in chosen])
        return history

    def _strided(self, buffer: deque[dict[str, Any]]) -> int:
        return -(-len(buffer) // self.action_block)

    def _frames(self, buffer: deque[dict[str, Any]], key: str, n: int) -> Any:
        real = min(n, self._strided(buffer))
        frames = [buffer[-1 - back * self.action_block][key] for back in reversed(range(real))]
        return _merge_time([frames[0]] * (n - real) + frames)

    def _blocks(self, buffer: deque[dict[str, Any]], key: str, n: int) -> Any:
        real = min(n, self._strided(buffer)) - 1
        blocks: list[Any] = []
        for block in range(real):
            last = len(buffer) - (real - 1 - block) * self.action_block
            steps = [buffer[index][key] for index in range(last - self.action_block, last)]
            blocks.append(_without_nan(_merge_time(steps)))
        blank = _zeros_like(buffer[-1][key], self.action_block)
        return _stack_envs([blank] * (n - 1 - real) + blocks)

    def num_strided(self, env_ids: Sequence[int] | None = None) -> list[int]:
        """How many frames of :meth:`get` are real, per environment: 0 without a step."""
        chosen = self._buffers if env_ids is None else [self._buffers[index] for index in env_ids]
        return [self._strided(buffer) for buffer in chosen]

    def reset(self, env_ids: Sequence[int] | None = None) -> None:
        """Forgets the environments ``env_ids`` (None: all): their episodes are over."""
        for index in range(self.n_envs) if env_ids is None else env_ids:
            self._buffers[index].clear()

    def __len__(self) -> int:
        """Steps of the environment that has the fewest."""
        return min(map(len, self._buffers))


def _slice_env(value: Any, index: int) -> Any:
    """One environment of a value, copied; what is no array belongs to all."""
    if is_tensor(value):
        # It may lie on an array of the World's.
        return value[index].clone()
    return np.array(value[index]) if isinstance(value, np.ndarray) else value


def _merge_time(steps: list[Any]) -> Any:
    """Steps joined along the time, which scalars have none of."""
    if is_tensor(steps[0]):
        import torch

        return torch.stack(steps) if steps[0].ndim == 0 else torch.cat(steps)
    if isinstance(steps[0], np.ndarray) and steps[0].ndim > 0:
        return np.concatenate(steps)
    return np.array(steps)


def _stack_envs(rows: list[Any]) -> Any:
    """Rows as one array."""
    if is_tensor(rows[0]):
        import torch

        return torch.stack(rows)
    return np.stack(rows) if isinstance(rows[0], np.ndarray) else np.array(rows)


def _without_nan(values: Any) -> Any:
    flat = values.reshape(-1)
    return flat.nan_to_num(nan=0.0) if is_tensor(flat) else np.nan_to_num(flat, nan=0.0)


def _zeros_like(step: Any, count: int) -> Any:
    """A block of zeros as large as ``count`` such steps."""
    if is_tensor(step):
        return step.new_zeros(count * step.numel())
    step = np.asarray(step)
    return np.zeros(count * step.size, step.dtype)
