"""The writer behind every built-in format: whole episodes, each safe from crashes once it is written."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from .._access import checked_access
from .._arguments import target_path
from .._core import core as _swm
from ..world.ids import check_recorded_id
from ._columns import flattened, refuse_objects
from ._tensors import to_numpy
from .format import EPISODE_DATA_KEY, split_episode_data, validate_write_mode

if TYPE_CHECKING:
    from typing_extensions import Self

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")
_TYPES = {"b1": "b1", "u1": "u1", "i1": "i4", "i2": "i4", "i4": "i4", "u2": "i4", "u4": "i8", "i8": "i8"}
# Columns of images, by the names that the environments give them.
IMAGES = ("pixels", "goal")
_FLOATS = {"f2": "f4", "f4": "f4", "f8": "f8"}


def as_column(name: str, values: Any) -> Any:
    """The values of a column as datasets hold them: an array ``(T, …)``, or a list of ``str``.

    Raises:
        TypeError: They are objects that are neither numbers nor text, or no values of steps.
        ValueError: Their shapes differ from step to step.
    """
    steps: list[Any] = list(values) if isinstance(values, (list, tuple)) else []  # pyright: ignore[reportUnknownArgumentType]
    parts: list[Any] = [cast("Any", values), *steps]
    if any(isinstance(part, np.ma.MaskedArray) and np.ma.is_masked(cast("Any", part)) for part in parts):
        raise TypeError(f"column {name!r} is a masked array, whose masked values would be written; give others in their place: values.filled(np.nan)")
    refuse_objects(name, values, steps)
    try:
        array = to_numpy([to_numpy(value) for value in steps] if steps and hasattr(steps[0], "detach") else values)
    except ValueError as error:
        raise ValueError(_ragged(name, steps) or f"column {name!r}: {error}") from error
    if array.dtype.name == "bfloat16":  # of ml_dtypes
        array = array.astype(np.float32)
    if array.ndim == 0:
        raise TypeError(f"column {name!r} is the single value {array.item()!r}; give one per step: [{array.item()!r}] * T")
    kind = f"{array.dtype.kind}{array.dtype.itemsize}"
    if array.dtype.kind in "USO":
        return _texts(name, array)
    if kind == "u8" and array.size and array.max() > np.iinfo(np.int64).max:
        raise ValueError(f"column {name!r} has values beyond the range of int64")
    target = {**_TYPES, **_FLOATS, "u8": "i8"}.get(kind)
    if target is None:
        raise TypeError(f"column {name!r} is {array.dtype}; datasets hold bool, integers, float32, float64 and text")
    return np.ascontiguousarray(array, dtype=target)


def _texts(name: str, array: NDArray[Any]) -> list[str]:
    """A column of texts, one per step."""
    texts = array.reshape(-1).tolist()
    refuse_objects(name, texts, texts)
    if array.ndim > 1:
        raise TypeError(f"column {name!r} is text of shape {list(array.shape)}; datasets hold one text per step: make a column of each")
    try:
        return [value.decode() if isinstance(value, (bytes, bytearray)) else str(value) for value in array.tolist()]
    except UnicodeDecodeError as error:
        raise TypeError(f"column {name!r} holds bytes that are no text of UTF-8; give them as uint8: np.frombuffer(value, np.uint8)") from error


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


def _checked(metadata: Any) -> dict[str, Any]:
    """Metadata that JSON can hold, of an environment that may exist."""
    if not isinstance(metadata, Mapping):
        raise _swm.DataError(f"metadata is {type(metadata).__name__}; give a dict such as {{'env': 'swm/PushT-v1', 'seed': 3}}")
    found = {str(key): value for key, value in cast("Mapping[Any, Any]", metadata).items()}
    for name, value in found.items():
        try:
            json.dumps(value)
        except (TypeError, ValueError):
            raise _swm.DataError(f"metadata: `{name}` is {type(value).__name__}; give numbers, text, lists and dicts") from None
    if "env" in found:
        check_recorded_id("metadata: `env`", found["env"])
    return found


class NativeWriter:
    """Appends episodes to a dataset; a context manager.

    Args:
        path: The file or folder.
        mode: ``"append"`` continues a dataset that exists, ``"overwrite"`` replaces it, ``"error"`` refuses. None appends, as the
            reference does, with a warning where a dataset exists.
        quality: Of images in formats that lose some, 1 to 100.
        metadata: How the episodes were made, as :attr:`NativeDataset.metadata` has it. Its ``env`` is the id of an environment of
            this package or of Gymnasium, or one of your own with another namespace.

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
        mode: str | None = None,
        quality: int | None = None,
        metadata: dict[str, Any] | None = None,
    ) -> None:
        self.mode: str = validate_write_mode("append" if mode is None else mode)
        self._mode_is_given = mode is not None
        if quality is not None and not 1 <= quality <= 100:
            raise ValueError(f"quality={quality}; give 1 to 100, or None for the default of the format")
        self.path: Path = target_path("path", path)
        self.quality = quality
        self.fps: float | None = None
        self.key_frame_period: int | None = None
        self.last_row: str | None = None
        self.metadata: dict[str, Any] | None = None if metadata is None else _checked(metadata)
        self._writer: _swm.EpisodeWriter | None = None
        self._known: dict[str, tuple[int, ...]] | None = None
        self._constant: list[str] = []
        self._once_noted = False

    def _exists(self) -> bool:
        return (self.path / self._marker).exists() if self._marker else self.path.exists()

    def __enter__(self) -> Self:
        with checked_access(self.path):
            self._begin()
        return self

    def _begin(self) -> None:
        exists = self._exists()
        if exists and self.mode == "error":
            raise FileExistsError(f"{self.path} already exists; use mode='append' to continue it or mode='overwrite'")
        metadata = self.metadata
        if exists and self.mode == "append":
            there = _swm.Reader.open(self.path, self.native_format)
            if not self._mode_is_given:
                logger.warning(
                    "%s exists, with %d episodes before this: new ones are appended, which is the default; give mode='append' to do so without "
                    "this warning, mode='overwrite' to replace the dataset, or mode='error' to refuse",
                    self.path,
                    len(there.lengths),
                )
            self._known = {name: tuple(shape) for name, _, shape, _ in there.fields if name != "ep_idx"}
            self._constant = [name for name, _, _, kind in there.fields if kind == "episode"]
            runs = json.loads(there.runs)
            if metadata is None and runs:
                # Episodes of Python code continue what was recorded, and are no replay of it.
                metadata = runs[-1][1] | {"policy": "unknown", "from_recorded_rows": True}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise _swm.DataError(f"{self.path.parent} is a file, so that {self.path.name} cannot be in it; give another path") from None
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

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the dataset."""
        if self._writer is not None:
            with checked_access(self.path):
                self._writer.finish()
            self._writer = None

    def write_episode(self, ep_data: dict[str, Any]) -> None:
        """Appends one episode: ``{column: (T, …) or a list of T values}``.

        A dict of columns, or a dict at each step, becomes columns with dotted names: ``{"obs": {"arm": (T, 7)}}`` is ``obs.arm``.

        Raises:
            TypeError: A column holds objects that are neither numbers nor text, such as None.
            ValueError: The columns are not those of the episodes before.
        """
        if self._writer is None:
            raise RuntimeError(f"{type(self).__name__} used outside of a `with` block")
        if not isinstance(cast("Any", ep_data), Mapping):
            raise TypeError(f"an episode is a dict {{column: values of T steps}}, found {type(ep_data).__name__}; write several by write_episodes")
        ep_data, once = split_episode_data(ep_data)
        if once and not self._once_noted:
            self._once_noted = True
            logger.warning("format %r does not support %s; %s are left out", self.native_format, EPISODE_DATA_KEY, sorted(once))
        columns = {name: as_column(name, values) for name, values in flattened(ep_data).items() if name != "ep_idx"}
        self._check(columns)
        with checked_access(self.path):
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
