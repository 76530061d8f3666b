"""Values that an episode has once: a Lance table ``<name>_episodes`` with a row per episode, next to the table of their steps.

The reference keeps them there, too.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..._core import core as _swm
from ..writers import as_column


def table_of(path: Path) -> Path:
    """Where the values of the table at ``path`` are."""
    return path.with_name(f"{path.stem}_episodes.lance")


class EpisodeTable:
    """Appends a row of values per episode.

    Args:
        path: The table of the steps.
        mode: As of the writer of the steps.
        goes_on: Whether that table exists and is continued.
    """

    def __init__(self, path: Path, mode: str, goes_on: bool) -> None:
        self._steps = path
        self._goes_on = goes_on
        self._mode = mode
        self._names: set[str] | None = None
        self._writer: _swm.EpisodeWriter | None = None
        if goes_on:
            there = table_of(path)
            self._names = {name for name, *_ in _swm.Reader.open(there, "lance").fields if name != "ep_idx"} if there.is_dir() else set()

    def row(self, values: dict[str, Any]) -> list[tuple[str, Any]]:
        """The values of an episode as :meth:`write` takes them. Raises where they differ in kind from those before."""
        if self._names is not None and self._names != values.keys():
            if self._goes_on and not self._names:
                raise ValueError(
                    f"{self._steps} has episodes without episode data, and cannot get {sorted(values)} now. Regenerate the dataset with it"
                )
            raise ValueError(
                f"episode-data key mismatch on {self._steps}: {sorted(values)}, the episodes before have {sorted(self._names)}"
            )
        row: list[tuple[str, Any]] = []
        for name, value in values.items():
            if isinstance(value, (bytes, bytearray)):
                raise TypeError(f"episode data {name!r} is {type(value).__name__}; give numbers, arrays of one shape, or text")
            row.append((name, as_column(name, [value] if isinstance(value, str) else np.asarray(value)[None])))
        return row

    def write(self, row: list[tuple[str, Any]]) -> None:
        """Appends the values of an episode."""
        self._names = {name for name, _ in row}
        if not row:
            return
        if self._writer is None:
            self._writer = _swm.EpisodeWriter(table_of(self._steps), "lance", self._mode)
        self._writer.write_episode(row)

    def close(self) -> None:
        """Ends the table."""
        if self._writer is not None:
            self._writer.finish()
            self._writer = None
