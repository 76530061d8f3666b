"""What environments that are Python objects return, as named columns: flattened, stacked, and with a value where there is none.

Missing is NaN for floats, -1 for signed integers, 0 for unsigned ones, False, and ``""`` for text, as in datasets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt

__all__ = ["Table", "flat", "is_tensor", "missing"]

# Kinds of NumPy's types that are numbers.
_NUMBERS = "biuf"
# Longer texts do not fit into HDF5.
_TEXT = 256


def is_tensor(value: Any) -> bool:
    """Whether a value is a torch tensor, without importing torch."""
    return type(value).__module__.partition(".")[0] == "torch" and hasattr(value, "unsqueeze")


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Values by dotted names: a dict's by their keys, and those of a tuple or list that is no array by their positions.

    Numbers, and lists of them, become arrays. Texts, tensors and values that are none of these stay as they are.
    """
    found: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            found.update(flat(cast("Mapping[str, Any]", value), f"{name}."))
        elif isinstance(value, (list, tuple)):
            parts = cast("Sequence[Any]", value)
            array = _array(parts)
            found.update({name: array} if array is not None else flat(dict(enumerate(parts)), f"{name}."))  # type: ignore[arg-type]
        elif isinstance(value, (bool, int, float, np.generic, np.ndarray)):
            array = _array(value)
            found[name] = value if array is None else array
        else:
            found[name] = value.decode(errors="replace") if isinstance(value, bytes) else value
    return found


def _array(value: Any) -> npt.NDArray[Any] | None:
    """An array of numbers; None of what is none."""
    try:
        array = np.asarray(value)
    except ValueError:
        return None
    return array if array.dtype.kind in _NUMBERS else None


def is_array(value: Any) -> bool:
    """Whether it is an array of NumPy; its type stays open, as that of its elements is."""
    return isinstance(value, np.ndarray)


def missing(value: Any) -> Any:
    """What stands where a value such as this one is missing."""
    if is_tensor(value):
        return value.new_full(value.shape, float("nan") if value.is_floating_point() else 0)
    if not is_array(value):
        return "" if isinstance(value, str) else None
    kind = value.dtype.kind
    return np.full_like(value, np.nan if kind == "f" else -1 if kind == "i" else 0)


class Table:
    """The values of N environments by name: arrays and tensors ``(N, 1, …)``, of other values lists of lists ``[N][1]``.

    Args:
        count: N.
        observed: Names of observations, whose shape may not change.
        columns: A table that there is.
    """

    def __init__(
        self, count: int, observed: frozenset[str] = frozenset(), columns: dict[str, Any] | None = None
    ) -> None:
        self.columns: dict[str, Any] = {} if columns is None else columns
        #: Of every environment, the names that its last reset or step gave.
        self.given: list[frozenset[str]] = [frozenset()] * count
        #: Names that a step has ever given.
        self.stepped: set[str] = set()
        #: Why names that have no array cannot be recorded.
        self.unfit: dict[str, str] = {}
        #: Names that no environment gave: they go when all are reset.
        self.borrowed: set[str] = set()
        # Names that were None whenever they were given.
        self._empty: set[str] = set()
        self._observed = observed

    def begin(self, infos: Sequence[Mapping[str, Any]]) -> None:
        """All environments were reset: new arrays. Names known from before stay, missing where nothing was given."""
        given = [self._given(row, info) for row, info in enumerate(infos)]
        known = {name: column for name, column in self.columns.items() if name not in self.borrowed}
        self.borrowed.clear()
        self.columns = {name: column for name, column in known.items() if name in self._empty}
        for row, info in enumerate(given):
            for name, value in info.items():
                if name not in self.columns:
                    self._add(name, value)
                shape = np.shape(self.columns[name])[2:]
                if is_array(value) and row and value.shape != shape and name in self._observed:
                    raise ValueError(
                        f"`{name}` has the shape {shape} in environment 0 and {value.shape} in environment {row}; environments of "
                        "one World give it the same shape, or leave it out"
                    )
        for name, column in known.items():
            if name not in self.columns and not name.startswith("_"):
                self._add(name, column[0][0] if isinstance(column, list) else column[0, 0])
        for row, info in enumerate(given):
            self.put(row, info)

    def write(self, row: int, info: Mapping[str, Any], is_step: bool) -> None:
        """One environment was reset or stepped. What it does not give is missing, unless only resets ever give it."""
        given = self._given(row, info)
        if is_step:
            self.stepped.update(given)
        for name in given.keys() - self.columns.keys():
            self._add(name, given[name])
        for name, column in self.columns.items():
            if name in given or name.startswith("_") or (is_step and name not in self.stepped):
                continue
            if isinstance(column, list):
                column[row][0] = "" if isinstance(column[row][0], str) else None
            else:
                column[row, 0] = missing(column[row, 0] if is_tensor(column) else np.asarray(column[row, 0]))
        self.put(row, given)

    def _given(self, row: int, info: Mapping[str, Any]) -> dict[str, Any]:
        """What an environment gave: None is nothing, and shows until there is something."""
        given = flat(info)
        for name in [name for name, value in given.items() if value is None]:
            del given[name]
            if name not in self.columns:
                self._empty.add(name)
                self.columns[name] = [[None] for _ in self.given]
                self.unfit[name] = "it was None"
        for name in self._empty.intersection(given):
            self._empty.remove(name)
            del self.columns[name], self.unfit[name]
        self.given[row] = frozenset(given)
        return given

    def blank(self, name: str) -> npt.NDArray[Any]:
        """A missing value of a column that is an array or a tensor."""
        value = self.columns[name][0, 0]
        blank = missing(value if is_tensor(value) else np.asarray(value))
        return blank.cpu().numpy() if is_tensor(blank) else blank

    def _add(self, name: str, value: Any) -> None:
        """A column of missing values such as this one."""
        value = np.asarray(cast("Any", value)) if isinstance(value, np.generic) else value
        blank, count = missing(value), len(self.given)
        if is_tensor(value):
            import torch

            self.columns[name] = torch.stack([blank] * count).unsqueeze(1)
        elif is_array(value):
            self.columns[name] = np.stack([blank] * count)[:, None]
        else:
            self.columns[name] = [[blank] for _ in range(count)]

    def put(self, row: int, given: Mapping[str, Any]) -> None:
        """Write values of one environment into columns that there are."""
        for name, value in given.items():
            column = self.columns[name]
            if isinstance(column, list):
                column[row][0] = value
                if isinstance(value, str):
                    if (length := len(value.encode())) > _TEXT:
                        self.unfit.setdefault(name, f"it has a text of {length} bytes; {_TEXT} is the most that every format holds")
                else:
                    self.unfit.setdefault(name, f"{type(value).__name__} is no number, text or array of numbers")
                continue
            shape, found = tuple(column.shape[2:]), tuple(getattr(value, "shape", None) or np.shape(value))
            if isinstance(value, str) or [length for length in found if length != 1] != [length for length in shape if length != 1]:
                self._misfit(row, name, shape, value)
                continue
            # Axes of length 1 may come and go.
            value = value.reshape(shape) if found != shape and hasattr(value, "reshape") else value
            if is_array(column) and is_array(value):
                if not np.can_cast(value.dtype, column.dtype, "safe"):
                    # A first value of 0 must not make integers of what follows.
                    column = self.columns[name] = column.astype(np.result_type(column.dtype, value.dtype))
                column[row, 0] = value
            else:
                column[row, 0] = column.new_tensor(value) if is_tensor(column) and not is_tensor(value) else value

    def _misfit(self, row: int, name: str, shape: tuple[int, ...], value: Any) -> None:
        """A value of another shape or kind than before it: an error of observations, of infos the end of the array."""
        found = type(value).__name__ if isinstance(value, str) else f"the shape {np.shape(value)}"
        if name in self._observed:
            raise ValueError(
                f"`{name}` of environment {row} has {found}, and had {shape} when the environments were reset; give it the same "
                "shape at every step"
            )
        self.unfit.setdefault(name, f"it has {found}, and had the shape {shape} before")
        column = self.columns[name]
        self.columns[name] = [[column[other, 0]] for other in range(len(self.given))]
        self.columns[name][row][0] = value
