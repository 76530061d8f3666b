"""Datasets end to end."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._tensors import to_numpy
from .merge import dataset_list, union


class ConcatDataset:
    """The clips of the first dataset, then those of the next. Episodes are counted on.

    Args:
        datasets: The datasets, in order.

    Example:
        ``ConcatDataset([monday, tuesday])[len(monday)]`` is the first clip of ``tuesday``.
    """

    def __init__(self, datasets: list[Any]) -> None:
        self.datasets: list[Any] = dataset_list(datasets)
        self._cum = np.cumsum([0] + [len(dataset) for dataset in datasets])
        self._ep_cum = np.cumsum([0] + [len(dataset.lengths) for dataset in datasets])

    @property
    def column_names(self) -> list[str]:
        """The columns that any of them has."""
        return union([list(dataset.column_names) for dataset in self.datasets])

    @property
    def lengths(self) -> NDArray[Any]:
        """Rows of every episode of all datasets."""
        return np.concatenate([np.asarray(dataset.lengths) for dataset in self.datasets])

    @property
    def offsets(self) -> NDArray[Any]:
        """First rows of the episodes, counted over all datasets."""
        lengths = self.lengths
        return np.cumsum(lengths) - lengths

    @property
    def episode_column_names(self) -> list[str]:
        """Names of values per episode, of all datasets."""
        return union([list(getattr(dataset, "episode_column_names", [])) for dataset in self.datasets])

    def get_episode_data(self, episodes_idx: NDArray[Any] | list[int] | None = None) -> dict[str, list[Any]]:
        """Values per episode; ``None`` where a dataset lacks one."""
        names = self.episode_column_names
        if not names:
            return {}
        asked = to_numpy(range(int(self._ep_cum[-1])) if episodes_idx is None else episodes_idx).reshape(-1)
        values: dict[str, list[Any]] = {name: [None] * len(asked) for name in names}
        for dataset, local, positions in self._by_dataset(asked, self._ep_cum):
            if hasattr(dataset, "get_episode_data"):
                for name, found in dataset.get_episode_data(local).items():
                    for position, value in zip(positions.tolist(), found, strict=True):
                        values[name][position] = value
        return values

    def __len__(self) -> int:
        return int(self._cum[-1])

    def _by_dataset(self, asked: NDArray[Any], ends: NDArray[Any]) -> list[tuple[Any, NDArray[Any], NDArray[Any]]]:
        """For every dataset that is asked: it, the numbers within it, and their places in ``asked``."""
        owners = np.searchsorted(ends[1:], asked, side="right")
        groups: list[tuple[Any, NDArray[Any], NDArray[Any]]] = []
        for owner in np.unique(owners).tolist():
            (positions,) = np.nonzero(owners == owner)
            groups.append((self.datasets[owner], asked[positions] - ends[owner], positions))
        return groups

    def _loc(self, idx: int) -> tuple[int, int]:
        """The dataset of a clip, and its number there."""
        at = idx + len(self) if idx < 0 else idx
        if not 0 <= at < len(self):
            raise IndexError(f"clip {idx} of {len(self)}")
        owner = int(np.searchsorted(self._cum[1:], at, side="right"))
        return owner, int(at - self._cum[owner])

    def __getitem__(self, idx: int) -> dict[str, Any]:
        owner, local = self._loc(idx)
        return self.datasets[owner][local]

    def __getitems__(self, indices: list[int]) -> list[dict[str, Any]]:
        """Clips by number; each dataset is asked once."""
        asked = np.asarray([idx + len(self) if idx < 0 else idx for idx in indices], dtype=np.int64)
        items: list[Any] = [None] * len(indices)
        for dataset, local, positions in self._by_dataset(asked, self._cum):
            many = getattr(dataset, "__getitems__", None)
            found = many(local.tolist()) if many is not None else [dataset[at] for at in local.tolist()]
            for position, item in zip(positions.tolist(), found, strict=True):
                items[position] = item
        return items

    def load_chunk(self, episodes_idx: Any, start: Any, end: Any) -> list[dict[str, Any]]:
        """Slices of rows; episodes are counted over all datasets."""
        episodes, start, end = (to_numpy(value).reshape(-1) for value in (episodes_idx, start, end))
        chunks: list[Any] = [None] * len(episodes)
        for dataset, local, positions in self._by_dataset(episodes, self._ep_cum):
            found = dataset.load_chunk(local, start[positions], end[positions])
            for position, chunk in zip(positions.tolist(), found, strict=True):
                chunks[position] = chunk
        return chunks

    def get_col_data(self, col: str) -> NDArray[Any]:
        """A whole column of all datasets that have it."""
        parts = [dataset.get_col_data(col) for dataset in self.datasets if col in dataset.column_names]
        if not parts:
            raise KeyError(f"no dataset has column {col!r}; the columns are {self.column_names}")
        return np.concatenate(parts)

    def get_dim(self, col: str) -> int:
        """How many values a row of a column has."""
        for dataset in self.datasets:
            if col in dataset.column_names:
                return dataset.get_dim(col)
        raise KeyError(f"no dataset has column {col!r}; the columns are {self.column_names}")

    def get_row_data(self, row_idx: int | list[int]) -> dict[str, Any]:
        """Rows by their number, counted as the clips are: ``(…)`` for an int, ``(len, …)`` for a list.

        A column that some datasets lack has the rows of the others.
        """
        if isinstance(row_idx, (int, np.integer)):
            owner, local = self._loc(int(row_idx))
            return self.datasets[owner].get_row_data(local)
        rows = [self.get_row_data(row) for row in row_idx]
        keys = union([list(row) for row in rows])
        return {key: np.stack([row[key] for row in rows if key in row]) for key in keys}
