"""Datasets of clips: the base class, and datasets made of datasets.

:class:`Dataset` is map-style: ``dataset[i]`` is clip ``i``, a dict by column. Readers of files are in
:mod:`stable_worldmodel_rs.data.formats`; your own need ``column_names`` and ``_load_slice``, nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar, overload

import numpy as np
from numpy.typing import NDArray

from .._arguments import whole_number
from .._core import core as _swm
from ._tensors import to_numpy
from .concat import ConcatDataset
from .goals import GoalDataset
from .merge import MergeDataset

__all__ = ["ClipIndices", "ConcatDataset", "Dataset", "GoalDataset", "MergeDataset"]

Transform = Callable[[dict[str, Any]], dict[str, Any]]
ACTION = "action"
# Of a clip, in steps and from one to the next.
_MOST_ROWS = 2**31 - 1


class ClipIndices(Sequence[tuple[int, int]]):
    """``(episode, first row)`` of every clip, computed when asked for: opening a large dataset takes no time.

    Args:
        lengths: Rows of every episode, ``(E,)``.
        span: Rows of a clip.
    """

    def __init__(self, lengths: NDArray[Any] | Sequence[int], span: int) -> None:
        counts = np.maximum(np.asarray(lengths, dtype=np.int64) - span + 1, 0)
        self._ends = np.cumsum(counts)

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    @overload
    def __getitem__(self, index: int) -> tuple[int, int]: ...
    @overload
    def __getitem__(self, index: slice) -> list[tuple[int, int]]: ...
    def __getitem__(self, index: int | slice) -> tuple[int, int] | list[tuple[int, int]]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        size = len(self)
        at = index + size if index < 0 else index
        if not 0 <= at < size:
            raise IndexError(f"clip {index} of {size}")
        episode = int(np.searchsorted(self._ends, at, side="right"))
        return episode, int(at - (self._ends[episode - 1] if episode else 0))

    def arrays(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Episodes and first rows of all clips, ``(len,)`` each."""
        counts = np.diff(self._ends, prepend=0)
        episodes = np.repeat(np.arange(len(counts)), counts)
        return episodes, np.arange(len(self)) - (self._ends - counts)[episodes]

    def __iter__(self) -> Iterator[tuple[int, int]]:
        before = 0
        for episode, end in enumerate(self._ends.tolist()):
            for start in range(end - before):
                yield episode, start
            before = end

    def __eq__(self, other: object) -> bool:
        if isinstance(other, ClipIndices):
            return np.array_equal(self._ends, other._ends)
        return isinstance(other, Sequence) and list(self) == list(other)  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]

    # Equal to lists, which have no hash either.
    __hash__: ClassVar[None]  # type: ignore[assignment]  # pyright: ignore[reportIncompatibleMethodOverride]

    def __repr__(self) -> str:
        return f"ClipIndices({len(self)} clips of {len(self._ends)} episodes)"


class Dataset:
    """Clips of recorded episodes.

    A clip is ``num_steps`` rows, ``frameskip`` apart, of one episode. Columns are ``(num_steps, …)``; ``action`` keeps
    every action between two rows and is ``(num_steps, frameskip * A)``.

    Args:
        lengths: Rows of every episode, ``(E,)``.
        offsets: First rows of the episodes, counted over the whole dataset, ``(E,)``.
        frameskip: Distance of two rows of a clip.
        num_steps: Rows of a clip.
        transform: Changes every clip, dict to dict, before ``action`` is grouped by row.

    Example:
        >>> class Random(Dataset):
        ...     column_names = ["state"]
        ...     def _load_slice(self, ep_idx, start, end):
        ...         return {"state": np.zeros((len(range(start, end, self.frameskip)), 3))}
        >>> len(Random(np.array([10]), np.array([0]), num_steps=4))
        7
    """

    def __init__(
        self,
        lengths: NDArray[Any],
        offsets: NDArray[Any],
        frameskip: int = 1,
        num_steps: int = 1,
        transform: Transform | None = None,
    ) -> None:
        for name, value in (("frameskip", frameskip), ("num_steps", num_steps)):
            if value > _MOST_ROWS:
                raise ValueError(f"{name}={value} must be a whole number from 1 to {_MOST_ROWS}")
            if value < 1 or value != int(value):
                raise ValueError(f"{name}={value} must be a whole number, 1 or more")
        self.lengths = lengths
        self.offsets = offsets
        self.frameskip: int = int(frameskip)
        self.num_steps: int = int(num_steps)
        self.span: int = self.num_steps * self.frameskip
        self.transform = transform
        self.clip_indices: Sequence[tuple[int, int]] = ClipIndices(lengths, self.span)

    def _require_clips(self, name: object) -> None:
        """Refuses clips that are longer than every episode of the dataset ``name``; of no episodes there are none."""
        longest = int(self.lengths.max(initial=0))
        if longest and self.span > longest:
            raise _swm.DataError(
                f"{name}: a clip spans {self.span} rows (num_steps={self.num_steps} × frameskip={self.frameskip}), and the "
                f"longest episode has {longest}; use fewer steps or a smaller frameskip, or record longer episodes"
            )

    @property
    def column_names(self) -> list[str]:
        """Names of the columns of an item."""
        raise NotImplementedError(f"{type(self).__name__}.column_names")

    @property
    def episode_column_names(self) -> list[str]:
        """Names of values that an episode has once and beside its rows; most datasets have none."""
        return []

    def get_episode_data(self, episodes_idx: NDArray[Any] | list[int] | None = None) -> dict[str, list[Any]]:
        """Values of :attr:`episode_column_names`, one per asked episode (``None``: all), by name."""
        return {}

    def _load_slice(self, ep_idx: int, start: int, end: int) -> dict[str, Any]:
        """Rows ``start`` to ``end`` of an episode, every ``frameskip``-th; all rows of ``action``."""
        raise NotImplementedError(f"{type(self).__name__}._load_slice")

    def __len__(self) -> int:
        return len(self.clip_indices)

    def __getitem__(self, idx: int) -> dict[str, Any]:
        episode, start = self.clip_indices[idx]
        return self._grouped(self._load_slice(episode, start, start + self.span), self.num_steps)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self[index] for index in range(len(self)))

    @staticmethod
    def _grouped(steps: dict[str, Any], rows: int) -> dict[str, Any]:
        """The same with the actions of a row side by side, ``(rows, frameskip * A)``."""
        if ACTION in steps:
            steps[ACTION] = steps[ACTION].reshape(rows, -1)
        return steps

    def load_chunk(
        self, episodes_idx: NDArray[Any] | Sequence[int], start: NDArray[Any] | Sequence[int], end: NDArray[Any] | Sequence[int]
    ) -> list[dict[str, Any]]:
        """One slice of rows per entry: episode ``episodes_idx[i]``, rows ``start[i]`` to ``end[i]``.

        Raises:
            IndexError: There is no such episode.
            DataError: It has no such rows.
        """
        columns = [to_numpy(values).tolist() for values in (episodes_idx, start, end)]
        if len({len(values) for values in columns}) > 1:
            raise ValueError(f"load_chunk: {', '.join(str(len(values)) for values in columns)} episodes, starts and ends; give as many of each")
        slices = [(self._episode(episode), first, last) for episode, first, last in zip(*columns, strict=True)]
        for episode, first, last in slices:
            if not 0 <= first < last:
                rows = int(self.lengths[episode])
                raise _swm.DataError(f"load_chunk: rows {first} to {last} of episode {episode}, which has {rows} rows; give 0 <= start < end <= {rows}")
        return [
            self._grouped(self._load_slice(episode, first, last), (last - first) // self.frameskip)
            for episode, first, last in slices
        ]

    def load_episode(self, episode_idx: int) -> dict[str, Any]:
        """All rows of an episode (every ``frameskip``-th), by column; -1 is the last episode.

        Raises:
            IndexError: There is no such episode.
        """
        episode = self._episode(episode_idx)
        return self._load_slice(episode, 0, int(self.lengths[episode]))

    def _episode(self, number: Any) -> int:
        """The number of an episode, counted from the end where it is negative."""
        count, episode = len(self.lengths), whole_number("episode", number, least=-(2**63))
        if not -count <= episode < count:
            raise IndexError(f"there is no episode {episode}; there are {count}, counted from 0")
        return episode % count

    def get_col_data(self, col: str) -> NDArray[Any]:
        """A whole column, ``(rows of all episodes, …)``."""
        raise NotImplementedError(f"{type(self).__name__}.get_col_data")

    def get_dim(self, col: str) -> int:
        """How many values a row of a column has."""
        raise NotImplementedError(f"{type(self).__name__}.get_dim")

    def get_row_data(self, row_idx: int | list[int]) -> dict[str, Any]:
        """Rows by their number over the whole dataset: ``(…)`` by column for an int, ``(len, …)`` for a list."""
        raise NotImplementedError(f"{type(self).__name__}.get_row_data")

    def merge_col(self, source: list[str] | str, target: str, dim: int = -1) -> None:
        """Adds the column ``target``: the columns ``source`` (a list, or a regular expression) joined along ``dim``."""
        raise NotImplementedError(f"{type(self).__name__}.merge_col")
