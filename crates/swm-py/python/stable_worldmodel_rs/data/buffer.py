"""The replay buffer of online learning: the last episodes, whole, in memory.

It is a writer (``world.collect(writer=buffer)`` fills it), a dataset (a ``DataLoader`` reads its clips), and what
:class:`~stable_worldmodel_rs.data.Loader` takes a snapshot of.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._access import access_checked
from .._arguments import whole_number
from ._tensors import to_numpy
from .dataset import ACTION, ClipIndices, Dataset, Transform
from .format import EPISODE_DATA_KEY, get_format, split_episode_data

__all__ = ["ReplayBuffer", "classic_filter"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")
CLASSIC = ("pixels", "action", "reward", "terminated", "truncated")
Sampler = Callable[[int, "ReplayBuffer", int, int], Any]


class ReplayBuffer(Dataset):
    """A ring of rows that holds whole episodes. When a new one does not fit, the oldest leave.

    Args:
        max_steps: Rows that it holds at most.
        history_len: Rows of a clip.
        frameskip: Distance of two rows of a clip.
        sampler: ``(step, buffer, batch_size, history_len) -> clip numbers``, each below
            ``buffer.num_valid_ends(history_len)``; by default uniform, sampled from ``np.random.default_rng(seed)``.
        transform: Changes every clip of ``buffer[i]``, dict to dict.
        key_filter: Chooses the columns of an episode before it is stored, dict to dict.
        seed: Of the default sampler.

    Example:
        >>> buffer = ReplayBuffer(100_000, history_len=4)
        >>> world.collect(episodes=10, writer=buffer)
        >>> buffer.sample(64)["action"].shape
        (64, 4, 2)
    """

    def __init__(
        self,
        max_steps: int,
        history_len: int = 1,
        frameskip: int = 1,
        sampler: Sampler | None = None,
        transform: Transform | None = None,
        key_filter: Callable[[dict[str, Any]], dict[str, Any]] | None = None,
        seed: int | None = None,
    ) -> None:
        for name, value in (("max_steps", max_steps), ("history_len", history_len), ("frameskip", frameskip)):
            if whole_number(name, value, least=-(2**63)) <= 0:
                raise ValueError(f"{name} must be positive, not {value}")
        self.max_steps: int = int(max_steps)
        self.history_len: int = int(history_len)
        self.num_steps: int = self.history_len
        self.frameskip: int = int(frameskip)
        self.span: int = self.num_steps * self.frameskip
        self.transform = transform
        self.key_filter = key_filter
        self.rng: np.random.Generator = np.random.default_rng(seed)
        self.sampler: Sampler = sampler or _uniform
        self._cols: dict[str, NDArray[Any]] = {}
        self._head = 0
        self._size = 0
        self._episodes: deque[tuple[int, int]] = deque()  # First row in the ring, and rows.
        self._episode_meta: deque[dict[str, Any]] = deque()
        self._sample_step = 0
        # How many clips come before each episode's, `(E + 1,)`, for clips of one span; until the content changes.
        self._clip_starts: NDArray[np.int64] | None = None
        self._clip_starts_span = 0

    def __enter__(self) -> ReplayBuffer:
        return self

    def __exit__(self, *exc: object) -> None:
        return None

    def write_episode(self, ep_data: dict[str, Any]) -> None:
        """Appends one episode, ``{column: (T, …) or a list of T values}``."""
        columns, once = split_episode_data(ep_data)
        if columns and self.key_filter is not None:
            columns = self.key_filter(columns)
        arrays = {name: to_numpy(values) for name, values in columns.items()}
        length = self._check(arrays)
        if length == 0:
            return
        while self._size + length > self.max_steps:
            self._size -= self._episodes.popleft()[1]
            self._episode_meta.popleft()
        rows = self._ring(self._head + np.arange(length))
        for name, values in arrays.items():
            self._cols[name][rows] = values
        self._episodes.append((self._head, length))
        self._episode_meta.append(once)
        self._head = (self._head + length) % self.max_steps
        self._size += length
        self._clip_starts = None

    def write_episodes(self, episodes: Iterable[dict[str, Any]]) -> None:
        """Appends several episodes."""
        for episode in episodes:
            self.write_episode(episode)

    def _check(self, arrays: dict[str, NDArray[Any]]) -> int:
        """The length of an episode that fits; the first one decides on the columns."""
        what = "ReplayBuffer.write_episode:"
        lengths: dict[str, int] = {}
        for name, values in arrays.items():
            if values.ndim == 0:
                raise ValueError(f"{what} column {name!r} is scalar; give a value per step")
            lengths[name] = len(values)
        length = next(iter(lengths.values()), 0)
        for name, found in lengths.items():
            if found != length:
                raise ValueError(f"{what} column {name!r} has {found} steps, expected {length}")
        if length > self.max_steps:
            raise ValueError(f"{what} episode length {length} exceeds max_steps={self.max_steps}")
        if length and not self._cols:
            self._cols = {name: np.empty((self.max_steps, *values.shape[1:]), values.dtype) for name, values in arrays.items()}
        missing, more = sorted(self._cols.keys() - arrays.keys()), sorted(arrays.keys() - self._cols.keys())
        if length and (missing or more):
            raise ValueError(f"{what} schema mismatch; missing={missing}, extra={more}")
        for name, values in arrays.items():
            if length and values.shape[1:] != self._cols[name].shape[1:]:
                raise ValueError(f"{what} column {name!r} has per-step shape {values.shape[1:]}, not {self._cols[name].shape[1:]}")
        return length

    def _ring(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        return rows % self.max_steps

    @property
    def column_names(self) -> list[str]:
        """The columns; empty before the first episode."""
        return list(self._cols)

    @property
    def episode_column_names(self) -> list[str]:
        """Names of values that any of the episodes has beside its rows."""
        return list(dict.fromkeys(name for once in self._episode_meta for name in once))

    def get_episode_data(self, episodes_idx: NDArray[Any] | list[int] | None = None) -> dict[str, list[Any]]:
        """Those values by name, one per asked episode; ``None`` where an episode lacks one."""
        known = list(self._episode_meta)
        asked = range(len(known)) if episodes_idx is None else to_numpy(episodes_idx).reshape(-1).tolist()
        return {name: [known[episode].get(name) for episode in asked] for name in self.episode_column_names}

    @property
    def num_episodes(self) -> int:
        """Episodes that it holds."""
        return len(self._episodes)

    @property
    def num_steps_stored(self) -> int:
        """Rows that it holds."""
        return self._size

    @property
    def lengths(self) -> NDArray[np.int32]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Rows of every episode, the oldest first."""
        return np.asarray([length for _, length in self._episodes], dtype=np.int32)

    @property
    def offsets(self) -> NDArray[np.int64]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """First rows of the episodes, counted from the oldest."""
        lengths = self.lengths.astype(np.int64)
        return np.cumsum(lengths) - lengths

    @property
    def clip_indices(self) -> ClipIndices:  # pyright: ignore[reportIncompatibleVariableOverride]
        """``(episode, first row)`` of every clip."""
        return ClipIndices(self.lengths, self.span)

    def _get_clip_starts(self, span: int) -> NDArray[np.int64]:
        if self._clip_starts is None or self._clip_starts_span != span:
            counts = np.maximum(self.lengths.astype(np.int64) - span + 1, 0)
            self._clip_starts = np.concatenate([[0], np.cumsum(counts)])
            self._clip_starts_span = span
        return self._clip_starts

    def num_valid_ends(self, history_len: int | None = None) -> int:
        """How many clips of so many rows there are: what a sampler chooses from."""
        history = self.history_len if history_len is None else history_len
        return int(self._get_clip_starts(history * self.frameskip)[-1])

    def __len__(self) -> int:
        return self.num_valid_ends()

    def sample(self, batch_size: int, history_len: int | None = None, step: int | None = None) -> dict[str, NDArray[Any]]:
        """Clips that the sampler chooses, ``(batch_size, history_len, …)`` by column; ``transform`` is not applied.

        Args:
            batch_size: How many.
            history_len: Rows of a clip; default: the buffer's.
            step: Handed to the sampler; default: 0, 1, 2, … by call.
        """
        history = self.history_len if history_len is None else history_len
        for name, value in (("batch_size", batch_size), ("history_len", history)):
            if whole_number(name, value, least=-(2**63)) <= 0:
                raise ValueError(f"{name} must be positive, not {value}")
        if step is None:
            step, self._sample_step = self._sample_step, self._sample_step + 1
        chosen = np.asarray(self.sampler(int(step), self, batch_size, history))
        if chosen.shape != (batch_size,):
            raise ValueError(f"ReplayBuffer.sample: sampler returned shape {chosen.shape}, expected {(batch_size,)}")
        return self._gather(chosen.astype(np.int64), history)

    def _gather(self, clips: NDArray[np.int64], history: int) -> dict[str, NDArray[Any]]:
        """Clips by number, ``(B, history, …)`` by column."""
        span = history * self.frameskip
        before = self._get_clip_starts(span)
        size = int(before[-1])
        if clips.size and not (0 <= clips.min() and clips.max() < size):
            raise IndexError(f"ReplayBuffer: clip index out of range [0, {size})")
        episodes = np.searchsorted(before[1:], clips, side="right")
        firsts = np.asarray([first for first, _ in self._episodes], dtype=np.int64)
        starts = (firsts[episodes] + clips - before[episodes])[:, None]
        dense = self._ring(starts + np.arange(span))
        batch: dict[str, NDArray[Any]] = {}
        for name, values in self._cols.items():
            taken = values[dense if name == ACTION else dense[:, :: self.frameskip]]
            batch[name] = taken.reshape(len(clips), history, -1) if name == ACTION else taken
        return batch

    def __getitem__(self, idx: int) -> dict[str, Any]:
        size = len(self)
        if not -size <= idx < size:
            raise IndexError(f"clip {idx} of {size}" if size else f"clip {idx}: the buffer is empty")
        batch = self._gather(np.asarray([idx % size]), self.history_len)
        clip = {name: values[0] for name, values in batch.items()}
        return self.transform(clip) if self.transform is not None else clip

    def _load_slice(self, ep_idx: int, start: int, end: int) -> dict[str, Any]:
        """All rows ``start`` to ``end`` of an episode, without a frame skip."""
        if not 0 <= ep_idx < self.num_episodes:
            raise IndexError(f"episode {ep_idx} of {self.num_episodes}")
        first, length = self._episodes[ep_idx]
        if not 0 <= start <= end <= length:
            raise IndexError(f"rows {start} to {end} of an episode of {length}")
        rows = self._ring(first + np.arange(start, end))
        return {name: values[rows] for name, values in self._cols.items()}

    def get_col_data(self, col: str) -> NDArray[Any]:
        """A column of all episodes, the oldest first."""
        if col not in self._cols:
            raise KeyError(f"the buffer has no column {col!r}; the columns are {self.column_names}")
        return self._cols[col][self._all_rows()]

    def get_dim(self, col: str) -> int:
        """How many values a row of a column has."""
        return int(np.prod(self._cols[col].shape[1:]))

    def get_row_data(self, row_idx: int | list[int]) -> dict[str, Any]:
        """Rows by their number, counted from the oldest."""
        rows = self._all_rows()[row_idx]
        return {name: values[rows] for name, values in self._cols.items()}

    def _all_rows(self) -> NDArray[np.int64]:
        first = self._episodes[0][0] if self._episodes else 0
        return self._ring(first + np.arange(self._size))

    def episodes(self) -> Iterator[dict[str, Any]]:
        """Its episodes as writers take them, the oldest first."""
        for episode, once in enumerate(list(self._episode_meta)):
            columns = self._load_slice(episode, 0, self._episodes[episode][1])
            lists: dict[str, Any] = {name: list(values) for name, values in columns.items()}
            yield lists | {EPISODE_DATA_KEY: dict(once)} if once else lists

    @access_checked
    def dump(self, path: str | Path, format: str, mode: str = "overwrite", **kwargs: Any) -> None:
        """Writes its episodes to a file or folder.

        Args:
            path: The file or folder.
            format: Its format, one of :func:`~stable_worldmodel_rs.data.list_formats`.
            mode: What to do about one that exists.
            **kwargs: Arguments of the writer.
        """
        known = get_format(format)
        lost = [] if known.supports_episode_data else self.episode_column_names
        if lost:
            logger.warning("format %r does not support episode data; %s are left out", format, lost)
        with known.open_writer(path, mode=mode, **kwargs) as writer:
            writer.write_episodes(split_episode_data(episode)[0] if lost else episode for episode in self.episodes())

    def clear(self) -> None:
        """Forgets all episodes and keeps the memory."""
        self._head = self._size = 0
        self._episodes.clear()
        self._episode_meta.clear()
        self._clip_starts = None

    def __repr__(self) -> str:
        return (
            f"ReplayBuffer(episodes={self.num_episodes}, steps={self._size}/{self.max_steps}, "
            f"history_len={self.history_len}, frameskip={self.frameskip}, columns={self.column_names})"
        )


def _uniform(step: int, buffer: ReplayBuffer, batch_size: int, history_len: int) -> NDArray[np.int64]:
    clips = buffer.num_valid_ends(history_len)
    if clips == 0:
        raise RuntimeError(
            f"ReplayBuffer.sample: no clips of history_len={history_len}; it holds {buffer.num_episodes} episodes of "
            f"{buffer.num_steps_stored} steps"
        )
    return buffer.rng.integers(clips, size=batch_size)


def classic_filter(ep_data: dict[str, Any]) -> dict[str, Any]:
    """A ``key_filter`` that keeps ``pixels``, ``action``, ``reward``, ``terminated`` and ``truncated``."""
    return {name: values for name, values in ep_data.items() if name in CLASSIC}
