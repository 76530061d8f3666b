"""Recording of environments that are Python objects: rows of every episode, as the columns of one dataset."""

from __future__ import annotations

import logging
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from .columns import Table, is_tensor

__all__ = ["EpisodeRecorder"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")
# What stands where a step gave no value: no array holds it.
_NONE = object()


class EpisodeRecorder:
    """Keeps the rows of open episodes, one per environment, and makes columns of those that are over.

    The columns are those that are known when the first episode is over. A row without a value has a missing one; what only the
    reset gives is a constant of the episode. What cannot be recorded is noted once, by its name.
    """

    def __init__(self, count: int) -> None:
        self._rows: list[list[dict[str, Any]]] = [[] for _ in range(count)]
        # A blank value of every column of the dataset.
        self._columns: dict[str, Any] | None = None
        self._noted: set[str] = set()

    def keep(self, table: Table, mask: npt.NDArray[np.bool_]) -> None:
        """Keeps the present row of the environments of ``mask`` ``(N,)``."""
        for row in map(int, np.flatnonzero(mask)):
            names = [name for name in table.columns if name in table.given[row] and not name.startswith("_")]
            self._rows[row].append({name: _value(table.columns[name], row) for name in names if name not in table.unfit})

    def finish(self, table: Table, row: int) -> dict[str, list[Any]]:
        """The columns of an environment's episode, one value per row; the next episode begins."""
        rows, self._rows[row] = self._rows[row], []
        if self._columns is None:
            self._columns = self._choose(table)
        episode: dict[str, list[Any]] = {}
        for name, blank in self._columns.items():
            if name in table.unfit:
                raise ValueError(f"`{name}` cannot go on in the dataset: {table.unfit[name]}; give it as in the episodes before, or leave it out")
            values = [kept.get(name, _NONE) for kept in rows]
            if name not in table.stepped and values[0] is not _NONE:
                values = [values[0]] * len(values)
            episode[name] = [blank if value is _NONE else value for value in values]
        self._note(table)
        for name in episode:
            if name == "action" or name.startswith("action."):
                # Infos hold the last action; datasets hold the next one, and none at the end.
                episode[name].append(episode[name].pop(0))
        return episode

    def _choose(self, table: Table) -> dict[str, Any]:
        for name, column in table.columns.items():
            if not isinstance(column, list) and 0 in column.shape[2:]:
                table.unfit.setdefault(name, f"its shape {tuple(column.shape[2:])} holds no values")
        chosen = {name: column for name, column in table.columns.items() if name not in table.unfit and not name.startswith("_")}
        return {name: "" if isinstance(column, list) else table.blank(name) for name, column in chosen.items()}

    def _note(self, table: Table) -> None:
        assert self._columns is not None, "the columns were chosen"
        late = {name: "the dataset has no column of it, as no episode had one when the first was written" for name in table.columns}
        reasons = {**late, **table.unfit}
        for name, reason in reasons.items():
            if name not in self._columns and name not in self._noted and not name.startswith("_"):
                self._noted.add(name)
                logger.warning("`%s` is not recorded: %s", name, reason)


def _value(column: Any, row: int) -> Any:
    """The value of one environment, as NumPy has it, and as its own."""
    if isinstance(column, list):
        return cast("list[Any]", column)[row][0]
    value = column[row, 0]
    return value.detach().cpu().numpy().copy() if is_tensor(value) else np.array(value)
