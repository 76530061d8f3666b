"""The writer behind every built-in format: whole episodes, each safe from crashes once it is written."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .._core import core as _swm
from ._tensors import to_numpy
from .format import validate_write_mode

if TYPE_CHECKING:
    from typing_extensions import Self

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")
_TYPES = {"b1": "b1", "u1": "u1", "i1": "i4", "i2": "i4", "i4": "i4", "u2": "i4", "u4": "i8", "i8": "i8"}
# Columns of images, by the names that the environments give them.
IMAGES = ("pixels", "goal")
_FLOATS = {"f2": "f4", "f4": "f4", "f8": "f8"}


def as_column(name: str, values: Any) -> Any:
    """The values of a column as datasets hold them: an array ``(T, …)``, or a list of ``str``."""
    steps: list[Any] = list(values) if isinstance(values, (list, tuple)) else []  # pyright: ignore[reportUnknownArgumentType]
    try:
        array = to_numpy([to_numpy(value) for value in steps] if steps and hasattr(steps[0], "detach") else values)
    except ValueError as error:
        raise ValueError(_ragged(name, steps) or f"column {name!r}: {error}") from error
    if array.dtype.name == "bfloat16":  # of ml_dtypes
        array = array.astype(np.float32)
    kind = f"{array.dtype.kind}{array.dtype.itemsize}"
    if array.dtype.kind in "USO":
        return [value.decode() if isinstance(value, (bytes, bytearray)) else str(value) for value in array.reshape(-1).tolist()]
    if kind == "u8" and array.size and array.max() > np.iinfo(np.int64).max:
        raise ValueError(f"column {name!r} has values beyond the range of int64")
    target = {**_TYPES, **_FLOATS, "u8": "i8"}.get(kind)
    if target is None:
        raise TypeError(f"column {name!r} is {array.dtype}; datasets hold bool, integers, float32, float64 and text")
    return np.ascontiguousarray(array, dtype=target)


def _ragged(name: str, steps: list[Any]) -> str | None:
    """Which step of a column has another shape than the first one."""
    shapes: list[tuple[int, ...]] = [np.shape(to_numpy(value)) for value in steps]
    for step, shape in enumerate(shapes):
        if shape != shapes[0]:
            return f"column {name!r} has the shape {shapes[0]} at step 0 and {shape} at step {step}; give it one shape at every step"
    return None


def per_step(values: Any) -> tuple[int, ...]:
    """The shape of one row of a column."""
    return () if isinstance(values, list) else values.shape[1:]


class NativeWriter:
    """Appends episodes to a dataset; a context manager.

    Args:
        path: The file or folder.
        mode: ``"append"`` continues a dataset that exists, ``"overwrite"`` replaces it, ``"error"`` refuses.
        quality: Of images in formats that lose some, 1 to 100.
        metadata: How the episodes were made, as :attr:`NativeDataset.metadata` has it.

    Example:
        >>> with HDF5Writer("mine.h5") as writer:
        ...     writer.write_episode({"pixels": pixels, "action": actions})  # (T, H, W, 3), (T, A)
    """

    native_format: ClassVar[str] = ""
    _marker: ClassVar[str] = ""  # What of a folder says that it is a dataset.

    def __init__(
        self,
        path: str | Path,
        *,
        mode: str = "append",
        quality: int | None = None,
        metadata: dict[str, Any] | None = None,
    ) -> None:
        self.mode: str = validate_write_mode(mode)
        self.path: Path = Path(path)
        self.quality = quality
        self.fps: float | None = None
        self.key_frame_period: int | None = None
        self.last_row: str | None = None
        self.metadata = metadata
        self._writer: _swm.EpisodeWriter | None = None
        self._known: dict[str, tuple[int, ...]] | None = None
        self._constant: list[str] = []

    def _exists(self) -> bool:
        return (self.path / self._marker).exists() if self._marker else self.path.exists()

    def __enter__(self) -> Self:
        exists = self._exists()
        if exists and self.mode == "error":
            raise FileExistsError(f"{self.path} already exists; use mode='append' to continue it or mode='overwrite'")
        metadata = self.metadata
        if exists and self.mode == "append":
            there = _swm.Reader.open(self.path, self.native_format)
            self._known = {name: tuple(shape) for name, _, shape, _ in there.fields if name != "ep_idx"}
            self._constant = [name for name, _, _, kind in there.fields if kind == "episode"]
            runs = json.loads(there.runs)
            if metadata is None and runs:
                # Episodes of Python code continue what was recorded, and are no replay of it.
                metadata = runs[-1][1] | {"policy": "unknown", "from_recorded_rows": True}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._writer = _swm.EpisodeWriter(
            self.path,
            self.native_format,
            self.mode,
            metadata=None if metadata is None else json.dumps(metadata),
            quality=self.quality,
            fps=self.fps,
            key_frame_period=self.key_frame_period,
            last_row=self.last_row,
        )
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the dataset."""
        if self._writer is not None:
            self._writer.finish()
            self._writer = None

    def write_episode(self, ep_data: dict[str, Any]) -> None:
        """Appends one episode: ``{column: (T, …) or a list of T values}``."""
        if self._writer is None:
            raise RuntimeError(f"{type(self).__name__} used outside of a `with` block")
        columns = {name: as_column(name, values) for name, values in ep_data.items() if name != "ep_idx"}
        self._check(columns)
        self._writer.write_episode(list(columns.items()), self._constant)

    def _check(self, columns: dict[str, NDArray[Any] | list[str]]) -> None:
        shapes = {name: per_step(values) for name, values in columns.items()}
        if self._known is None:
            self._known = shapes
            self._note_no_images(columns)
        missing, more = sorted(self._known.keys() - shapes.keys()), sorted(shapes.keys() - self._known.keys())
        if missing or more:
            raise ValueError(f"schema mismatch on {self.path}: missing columns {missing}, unexpected columns {more}")
        for name, shape in shapes.items():
            if shape != self._known[name]:
                raise ValueError(f"shape mismatch on {self.path}: column {name!r} has {self._known[name]} per step, not {shape}; give it that shape, or write another file")

    def _note_no_images(self, columns: dict[str, NDArray[Any] | list[str]]) -> None:
        """Notes what looks like images of torch, which readers take for numbers."""
        for name, values in columns.items():
            if isinstance(values, list) or values.ndim != 4 or not {1, 3} & {values.shape[1], values.shape[3]}:
                continue
            if values.dtype != np.uint8 and name in IMAGES or values.dtype == np.uint8 and values.shape[3] not in (1, 3):
                logger.warning(
                    "%s: column %r is %s of shape %s per step, numbers and no images; images are uint8 (H, W, 3)",
                    self.path,
                    name,
                    values.dtype,
                    values.shape[1:],
                )

    def write_episodes(self, episodes: Iterable[dict[str, Any]]) -> None:
        """Appends several episodes."""
        for episode in episodes:
            self.write_episode(episode)
