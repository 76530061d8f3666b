"""Columns of several datasets of the same clips side by side."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from .._arguments import kind_of


def union(lists: list[list[str]]) -> list[str]:
    """All names, each once, in the order in which they first come."""
    return list(dict.fromkeys(name for names in lists for name in names))


def dataset_list(datasets: Any) -> list[Any]:
    """Datasets, given as a list.

    Raises:
        TypeError: A dataset by itself.
        ValueError: There are none.
    """
    if hasattr(datasets, "column_names"):
        raise TypeError(f"datasets is {kind_of(datasets)}; give a list: [dataset, …]")
    if not datasets:
        raise ValueError("Need at least one dataset")
    return datasets


class MergeDataset:
    """Datasets of equal length joined by columns: embeddings computed later, say, beside the recording.

    Args:
        datasets: The datasets; item ``i`` of each is the same clip.
        keys_from_dataset: The columns that each gives. By default each gives those that the ones before it lack.

    Example:
        ``MergeDataset([recording, embeddings])[0]`` has the columns of both.
    """

    def __init__(self, datasets: list[Any], keys_from_dataset: list[list[str]] | None = None) -> None:
        self.datasets: list[Any] = dataset_list(datasets)
        self._len = len(datasets[0])
        clips = [len(dataset) for dataset in datasets]
        if len(set(clips)) > 1:
            raise ValueError(f"MergeDataset joins columns of the same clips, and these have {clips}; ConcatDataset puts datasets end to end")
        if keys_from_dataset:
            self.keys_map = keys_from_dataset
        else:
            names = [list(dataset.column_names) for dataset in datasets]
            taken = [set(union(names[:at])) for at in range(len(names))]
            self.keys_map: list[list[str]] = [[key for key in own if key not in before] for own, before in zip(names, taken, strict=True)]

    @property
    def column_names(self) -> list[str]:
        """The columns of all, in order."""
        return [key for keys in self.keys_map for key in keys]

    @property
    def episode_column_names(self) -> list[str]:
        """Names of values per episode, of all datasets."""
        return union([list(getattr(dataset, "episode_column_names", [])) for dataset in self.datasets])

    def get_episode_data(self, episodes_idx: NDArray[Any] | list[int] | None = None) -> dict[str, list[Any]]:
        """Values per episode; of equal names the first dataset's."""
        values: dict[str, list[Any]] = {}
        for dataset in reversed(self.datasets):
            if hasattr(dataset, "get_episode_data"):
                values |= dataset.get_episode_data(episodes_idx)
        return {name: values[name] for name in self.episode_column_names if name in values}

    @property
    def lengths(self) -> NDArray[Any]:
        """Rows of every episode."""
        return self.datasets[0].lengths

    @property
    def offsets(self) -> NDArray[Any]:
        """First rows of the episodes."""
        return self.datasets[0].offsets

    def __len__(self) -> int:
        return self._len

    def _join(self, items: list[dict[str, Any]]) -> dict[str, Any]:
        pairs = zip(items, self.keys_map, strict=True)
        return {key: item[key] for item, keys in pairs for key in keys if key in item}

    def __getitem__(self, idx: int) -> dict[str, Any]:
        return self._join([dataset[idx] for dataset in self.datasets])

    def load_chunk(self, episodes_idx: Any, start: Any, end: Any) -> list[dict[str, Any]]:
        """Slices of rows, with all columns of all datasets."""
        merged: list[dict[str, Any]] = []
        for items in zip(*(dataset.load_chunk(episodes_idx, start, end) for dataset in self.datasets), strict=True):
            merged.append({key: value for item in items for key, value in item.items()})
        return merged

    def get_col_data(self, col: str) -> NDArray[Any]:
        """A whole column of the dataset that gives it."""
        for dataset, keys in zip(self.datasets, self.keys_map, strict=True):
            if col in keys:
                return dataset.get_col_data(col)
        raise KeyError(f"no dataset gives column {col!r}; the columns are {self.column_names}")

    def get_dim(self, col: str) -> int:
        """How many values a row of a column has."""
        for dataset, keys in zip(self.datasets, self.keys_map, strict=True):
            if col in keys:
                return dataset.get_dim(col)
        raise KeyError(f"no dataset gives column {col!r}; the columns are {self.column_names}")

    def get_row_data(self, row_idx: int | list[int]) -> dict[str, Any]:
        """Rows by their number."""
        return self._join([dataset.get_row_data(row_idx) for dataset in self.datasets])
