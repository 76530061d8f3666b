"""The reader behind every built-in format: clips of files, read by Rust.

Images come as ``(T, C, H, W)`` uint8, ``action`` as ``(T, frameskip * A)``, text as one ``str`` per clip. Items are torch
tensors where torch is installed, else NumPy arrays; both lie on memory that is theirs while they are held.
"""

from __future__ import annotations

import difflib
import json
import logging
import operator
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, cast

import numpy as np
from numpy.typing import NDArray

from .._arguments import as_json, kind_of, require_callable, whole_number
from .._arrays import image_sides
from .._core import core as _swm
from ..world.ids import note_renamed
from . import _show
from ._tensors import Rewards, converter, may_use_threads, sums_rewards, to_numpy
from .dataset import ACTION, Dataset, Transform

if TYPE_CHECKING:
    from typing_extensions import Self

INDICES = ("ep_idx", "episode_idx", "step_idx")
"""Columns that every dataset has: the episode and the step of a row. Computed where they are not stored."""
logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")
_LAYOUT = ("ep_len", "ep_offset")
_abandoned: list[Any] = []  # Open files of a parent process: a fork must not close them.


def _plain(argument: str, values: Any) -> dict[str, Any]:
    """Values of factors for JSON: arrays and tuples as lists."""
    if not isinstance(values, Mapping):
        raise TypeError(f"{argument} is {kind_of(values)}; give a dict of factors, such as {{'background.color': 'black'}}")
    return as_json(argument, values)


class Clips(Sequence[dict[str, Any]]):
    """Clips that were read together. :func:`~stable_worldmodel_rs.data.collate` takes :attr:`batch` without a copy.

    Attributes:
        batch: ``{column: (B, T, …)}``.
    """

    def __init__(self, batch: dict[str, Any], size: int) -> None:
        self.batch = batch
        self._size = size

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            items: list[dict[str, Any]] = [self[i] for i in range(*index.indices(self._size))]
            return items
        if not -self._size <= index < self._size:
            raise IndexError(index)
        return {key: values[index] for key, values in self.batch.items()}


class _Cached(Mapping[str, NDArray[Any]]):
    """The columns that are kept in memory, as arrays."""

    def __init__(self, dataset: NativeDataset) -> None:
        self._dataset = dataset

    def __getitem__(self, key: str) -> NDArray[Any]:
        if key not in self._dataset.cached_columns:
            raise KeyError(key)
        return self._dataset.get_col_data(key)

    def __iter__(self) -> Iterator[str]:
        return iter(self._dataset.cached_columns)

    def __len__(self) -> int:
        return len(self._dataset.cached_columns)


# Options of opening that are text, that are dicts, and that have few values, each with what to give.
_TEXTS = {"camera": "'top'", "env": "'mylab/Arm-v0'", "split": "'train'", "storage": "'decoded'"}
_DICTS = {"map": "{'proprio': 'obs.state'}", "env_options": "{'task': 'swingup'}"}
_CHOICES = {"flip": ("vertical", "180"), "channels": ("rgb", "bgr"), "fit": ("stretch", "crop", "pad")}
#: Their names, which are also arguments of `load_dataset`.
OPENING = (
    "map", "camera", "flip", "channels", "fps", "env", "env_options", "split", "max_steps", "shift", "image_size", "fit", "storage"
)  # fmt: skip
_LARGEST_SIDE = 4096


def as_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options of opening as the core has them in JSON; those that are None are left out.

    Raises:
        TypeError: One is of another kind than it should be.
        ValueError: There is no option of that name, or it has no such value.
    """
    return {name: _as_option(name, value) for name, value in options.items() if value is not None}


def _as_option(name: str, value: Any) -> Any:
    if name in _TEXTS:
        if not isinstance(value, (str, os.PathLike) if name == "storage" else str):
            raise TypeError(f"{name}={value!r}: give text, such as {name}={_TEXTS[name]}")
        text = str(os.fspath(cast("str | os.PathLike[str]", value)))
        if name == "env":
            note_renamed(text)
        return text
    if name in _DICTS:
        if not isinstance(value, Mapping):
            raise TypeError(f"{name}={value!r}: give a dict, such as {name}={_DICTS[name]}")
        return {str(key): as_json(f"{name}[{key!r}]", one) for key, one in cast("Mapping[Any, Any]", value).items()}
    if name in _CHOICES:
        if str(value) not in _CHOICES[name]:
            raise ValueError(f"{name}={value!r}; use {' or '.join(map(repr, _CHOICES[name]))}")
        return str(value)
    if name == "fps":
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
            raise TypeError(f"fps={value!r}: give a number of rows per second, such as fps=10")
        if not 0 < (rate := float(cast("Any", value))) < float("inf"):
            raise ValueError(f"fps={value}: give a finite number above 0")
        return rate
    if name == "max_steps":
        return whole_number(name, value, 1)
    if name == "shift":
        return whole_number(name, value, 0, 1)
    if name == "image_size":
        if isinstance(value, Mapping):
            return dict(cast("Mapping[str, Any]", value))
        height, width = image_sides(name, value)
        if not (1 <= height <= _LARGEST_SIDE and 1 <= width <= _LARGEST_SIDE):
            raise ValueError(f"image_size={value!r}: give sides of 1 to {_LARGEST_SIDE} pixels")
        return {"height": height, "width": width}
    meant = difflib.get_close_matches(name, OPENING, 1)
    raise ValueError(f"opening a dataset has no option {name!r}{f' (did you mean {meant[0]!r}?)' if meant else ''}; there are {', '.join(OPENING)}")


class NativeDataset(Dataset):
    """Clips of a dataset file or folder.

    Of a column of text, a clip and an episode have the text of their first row, as in the reference; :meth:`get_col_data` has those of all rows.

    Args:
        path: The file or folder.
        frameskip: Distance of two rows of a clip.
        num_steps: Rows of a clip.
        transform: Changes every clip, dict to dict.
        keys_to_load: The columns of an item; ``None``: all.
        keys_to_cache: Columns that are read into memory once.
        keys_to_merge: ``{new column: columns or a regular expression}``, joined along the last axis.
        image: ``(H, W)`` to which images are resized, antialiased.
        render: ``(H, W)`` of images that are rendered when they are read, for recordings without images of this
            package.
        look: ``{factor: value}`` of visual factors that rendered images show in place of the recorded ones, such as
            ``{"background.color": "black"}``.
        vary: Visual factors that are sampled for every clip: names, groups, ``*.color``, or ``visual`` for all of them. A
            clip's look depends on ``vary_seed``, :meth:`set_epoch` and its number. Whole columns and episodes show none.
        vary_share: The probability of each of these factors to be sampled for a clip.
        vary_usual: The probability of a clip to show none of them sampled.
        vary_seed: The seed of the looks.
        canonical: ``{factor: value}`` of the canonical look: adds the column ``canonical``, the same rows in that look.
            ``"recorded"``: the recorded one.
        episodes: The episodes to take, in this order; ``None``: all.
        rewards: ``"recorded"``: those of arriving at each row; ``"action"``: beside each row, the sum of those of the
            actions taken from it to the next. Rows, columns and whole episodes have them as recorded.
        options: How a dataset of another program is opened: ``map`` (new names of columns to those in its files),
            ``camera``, ``flip`` (``"vertical"``, ``"180"``), ``channels`` (``"rgb"``, ``"bgr"``), ``fps``, ``env``, ``env_options``, ``split``, ``max_steps``,
            ``shift``, ``storage``; of any dataset, ``image_size``, ``(H, W)`` to which images are resized by area when they are
            read, with ``fit`` (``"stretch"``, ``"crop"``, ``"pad"``) where their shape changes. :func:`load_dataset` takes each
            of them as an argument.

    Example:
        >>> dataset = load_dataset("pusht.h5", num_steps=4, frameskip=5)
        >>> dataset[0]["pixels"].shape
        torch.Size([4, 3, 64, 64])
    """

    native_format: ClassVar[str | None] = None

    def __init__(
        self,
        path: str | Path,
        *,
        frameskip: int = 1,
        num_steps: int = 1,
        transform: Transform | None = None,
        keys_to_load: Sequence[str] | None = None,
        keys_to_cache: Sequence[str] | None = None,
        keys_to_merge: Mapping[str, list[str] | str] | None = None,
        image: tuple[int, int] | None = None,
        render: tuple[int, int] | None = None,
        look: Mapping[str, Any] | None = None,
        vary: Sequence[str] | None = None,
        vary_share: float = 1.0,
        vary_usual: float = 0.0,
        vary_seed: int = 0,
        canonical: Mapping[str, Any] | Literal["recorded"] | None = None,
        episodes: Sequence[int] | None = None,
        rewards: Rewards = "recorded",
        options: Mapping[str, Any] | None = None,
    ) -> None:
        for argument, keys in (("keys_to_load", keys_to_load), ("keys_to_cache", keys_to_cache), ("vary", vary)):
            if isinstance(keys, str):
                raise TypeError(f"{argument}={keys!r} is a text; give a list: [{keys!r}]")
        if keys_to_load is not None and not len(keys_to_load):
            raise ValueError("keys_to_load is empty; name columns, such as keys_to_load=['pixels', 'action'], or leave it out for all")
        # An address is no path: that would make one slash of two.
        self.path: Any = str(path) if _swm.is_remote(str(path)) else Path(path)
        for name, value in (("num_steps", num_steps), ("frameskip", frameskip)):
            if not isinstance(cast("Any", value), (int, float, np.number)):
                whole_number(name, value, 1)
        require_callable("transform", transform, "a clip, {column: (T, …)}")
        if isinstance(cast("Any", episodes), str):
            raise TypeError(f"episodes={episodes!r} is a text; give a list of numbers: [0, 1]")
        image = None if image is None else image_sides("image", image)
        render = None if render is None else image_sides("render", render)
        self.image = image
        self.rewards: Rewards = rewards
        sums_rewards(rewards)
        self._render = render
        looks = None if not vary else {"vary": list(vary), "share": vary_share, "usual": vary_usual, "seed": whole_number("vary_seed", vary_seed, most=2**64 - 1)}
        for name, share in (("vary_share", vary_share), ("vary_usual", vary_usual)):
            if not 0 <= share <= 1:
                raise ValueError(f"{name}={share}: give a number from 0 to 1")
        self._looks: tuple[str, str | None, str | None] = (
            json.dumps({} if look is None else _plain("look", look)),
            None if looks is None else json.dumps(looks),
            None if canonical is None else json.dumps({} if canonical == "recorded" else _plain("canonical", canonical)),
        )
        if render is None and (look or vary or canonical is not None):
            raise ValueError("look, vary and canonical are of images that are rendered; give their size: render=(64, 64)")
        if vary and "pixels" in (keys_to_cache or ()):
            raise ValueError("keys_to_cache: images of sampled looks differ from epoch to epoch; leave out 'pixels'")
        self._epoch = 0
        self._resize: tuple[tuple[int, int], str | None] | None = None
        self._options: str | None = json.dumps(given) if options and (given := as_options(options)) else None
        self.episodes: list[int] | None = None if episodes is None else [int(episode) for episode in episodes]
        self._merged: dict[str, NDArray[Any]] = {}
        self.cached_columns: list[str] = []
        self._pid = os.getpid()
        self._reader: _swm.Reader | None = self._open()
        for column, reason in self._reader.skipped:
            logger.warning("%s: the column `%s` is left out: %s", self.path, column, reason)
        self._clips: _swm.ClipReader | None = None
        self._table: dict[str, tuple[int, str, list[int], str]] | None = None
        lengths = self._reader.lengths
        super().__init__(lengths, np.cumsum(lengths) - lengths, frameskip, num_steps, transform)
        self._require_clips(self.path)
        stored = [field[0] for field in self._reader.fields]
        if keys_to_load is not None:
            self._keys = [key for key in dict.fromkeys(keys_to_load) if key not in _LAYOUT]
            self._require([key for key in self._keys if key not in (keys_to_merge or {})], stored)
        else:
            # Files of this package always have the episode's number; it is no part of a clip.
            own = self._recorded_here()
            self._keys = [key for key in stored if not (own and key == "ep_idx")]
        for target, source in (keys_to_merge or {}).items():
            self.merge_col(source, target)
        cached = [key for key in dict.fromkeys(keys_to_cache or ()) if key not in self.cached_columns]
        self._require(cached, stored)
        self.cached_columns += [key for key in cached if key in stored]
        if cached or any(key not in stored for key in self._keys):
            self._reset()

    def _require(self, keys: Sequence[str], stored: Sequence[str]) -> None:
        missing = [key for key in keys if key not in stored and key not in INDICES]
        if missing:
            can_render = missing[0] == "pixels" and self._render is None and self._recorded_here()
            hint = "; render=(64, 64) renders the images of a recording without them" if can_render else ""
            raise KeyError(f"{self.path} has no column {missing[0]!r}{hint}; the columns are {list(stored)}")

    def _recorded_here(self) -> bool:
        """Whether this package recorded the file, which then names its runs."""
        return self._reader is not None and self._reader.runs != "[]"

    def _open(self) -> _swm.Reader:
        reader = _swm.Reader.open(self.path, self.native_format, self._options)
        if self._render is not None:
            factors, looks, canonical = self._looks
            reader = reader.rendered(self._render, factors=factors, looks=looks, canonical=canonical)
        if self._resize is not None:
            reader = reader.resized(*self._resize)
        if self.episodes is not None:
            reader = reader.subset(self.episodes)
        virtual = [key for key in getattr(self, "_keys", []) if key in INDICES]
        merged = dict(self._merged)
        if virtual:
            stored = [field[0] for field in reader.fields]
            merged |= {key: self._index_column(key) for key in virtual if key not in stored}
        if merged:
            reader = _swm.Reader.memory(str(self.path), self.lengths.tolist(), list(merged.items())).beside(reader)
        stored_cache = [key for key in self.cached_columns if key not in merged]
        return reader.cached(stored_cache) if stored_cache else reader

    def _reset(self) -> None:
        self._reader = None
        self._clips = None
        self._table = None

    @property
    def reader(self) -> _swm.Reader:
        """The open file. In a forked process it is opened again."""
        if self._pid != os.getpid():
            _abandoned.append((self._reader, self._clips))
            self._reset()
            self._pid = os.getpid()
        if self._reader is None:
            self._reader = self._open()
        return self._reader

    @property
    def clips(self) -> _swm.ClipReader:
        """Clips by number, with the keys, steps and image size of this dataset."""
        reader = self.reader
        if self._clips is None:
            self._clips = _swm.ClipReader(
                reader,
                num_steps=self.num_steps,
                frameskip=self.frameskip,
                keys=self._keys,
                image=self.image,
                threads=None if may_use_threads() else 1,
                action_rewards=sums_rewards(self.rewards),
            )
        return self._clips

    @property
    def _cache(self) -> Mapping[str, NDArray[Any]]:
        return _Cached(self)

    @property
    def _fields(self) -> dict[str, tuple[int, str, list[int], str]]:
        """By column: its position, type, shape and kind."""
        if self._table is None:
            fields = self.reader.fields
            self._table = {name: (at, dtype, shape, kind) for at, (name, dtype, shape, kind) in enumerate(fields)}
        return self._table

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_reader": None, "_clips": None}

    @property
    def column_names(self) -> list[str]:
        """The columns of an item."""
        return list(self._keys)

    @property
    def metadata(self) -> dict[str, Any] | None:
        """How it was recorded: environment, settings, policy, seed, versions; ``None`` for files of other programs."""
        runs = self.runs
        return runs[0][1] if runs else None

    @property
    def runs(self) -> list[tuple[int, dict[str, Any]]]:
        """``(first episode, metadata)`` of every run that recorded into it."""
        return [(first, metadata) for first, metadata in json.loads(self.reader.runs)]

    @property
    def mapping(self) -> dict[str, str]:
        """The columns of a dataset of another program, and their names in its files."""
        return self.reader.mapping

    @property
    def notes(self) -> list[str]:
        """What a user of a dataset of another program has to know."""
        return self.reader.notes

    @property
    def skipped(self) -> list[tuple[str, str]]:
        """Columns of the file that cannot be read, with the reason."""
        return self.reader.skipped

    def _finish(self, name: str, values: Any, shape: list[int], batched: int, planar: bool) -> Any:
        """The axes of images as the reference has them: channels first if there are 1 or 3, whatever the type."""
        if len(shape) != 3 or not hasattr(values, "shape"):
            return values
        first = batched + 1
        if shape[2] in (1, 3):
            return values if planar else np.moveaxis(values, -1, first)
        return np.moveaxis(values, first, -1) if planar else values

    def _batch(self, indices: list[int]) -> dict[str, Any]:
        """Clips by number, ``(B, T, …)`` arrays by column."""
        fields = self._fields
        read = self.clips.read(indices, self._epoch)
        return {
            key: values if key == ACTION else self._finish(key, values, fields[key][2], 1, fields[key][1] == "uint8")
            for key, values in read.items()
        }

    def _clip(self, arrays: dict[str, Any]) -> dict[str, Any]:
        """One clip of a batch as an item."""
        convert = converter()
        clip = {key: convert(values) for key, values in arrays.items()}
        if self.transform is None:
            return clip
        if ACTION in clip:
            clip[ACTION] = clip[ACTION].reshape(self.span, -1)
        changed: Any = self.transform(clip)
        if not isinstance(changed, dict):
            raise TypeError(f"transform= returned {kind_of(changed)}; it gets a clip, {{column: (T, …)}}, and must return the dict: end it with `return clip`")
        return self._grouped(cast("dict[str, Any]", changed), self.num_steps)

    def set_epoch(self, epoch: int) -> None:
        """Sets the epoch, on which the sampled looks of clips depend (``vary``). Workers of a ``DataLoader`` that were started before
        keep the old one."""
        self._epoch = int(epoch)

    @property
    def _is_plain(self) -> bool:
        """Whether clips are what the file holds: no subclass reads them otherwise."""
        return type(self)._load_slice is NativeDataset._load_slice

    def __getitem__(self, idx: int) -> dict[str, Any]:
        if not self._is_plain:
            return super().__getitem__(idx)
        size = len(self)
        try:
            number = operator.index(idx)
        except TypeError:
            fix = "a column is read by get_col_data" if isinstance(cast("Any", idx), str) else "for several, dataset.__getitems__([0, 1, 2])"
            raise TypeError(f"dataset[{idx!r}]: clips have whole numbers; {fix}") from None
        if not -size <= number < size:
            raise IndexError(f"clip {number} of {size}")
        batch = self._batch([number % size])
        return self._clip({key: values[0] for key, values in batch.items()})

    def __getitems__(self, indices: Sequence[int]) -> Sequence[dict[str, Any]]:
        """Clips by number, read at once on several threads; what ``torch.utils.data.DataLoader`` calls.

        Pass ``collate_fn=swm.data.collate`` to the ``DataLoader``, and the batch is not copied again.
        """
        if not self._is_plain:
            return [self[index] for index in indices]
        size = len(self)
        wanted = [int(index) for index in indices]
        if any(not -size <= index < size for index in wanted):
            raise IndexError(f"a clip of {wanted} does not exist, there are {size}")
        if not wanted:
            return []
        batch = self._batch([index % size for index in wanted])
        if self.transform is not None:
            return [self._clip({key: values[at] for key, values in batch.items()}) for at in range(len(wanted))]
        convert = converter()
        return Clips({key: convert(values) for key, values in batch.items()}, len(wanted))

    def _load_slice(self, ep_idx: int, start: int, end: int) -> dict[str, Any]:
        fields, convert = self._fields, converter()
        arrays = self.reader.slice(int(ep_idx), int(start), int(end), self.frameskip, [fields[key][0] for key in self._keys])
        steps: dict[str, Any] = {}
        for key, values in zip(self._keys, arrays, strict=True):
            if isinstance(values, list):
                steps[key] = values[0] if values else ""
            else:
                steps[key] = convert(self._finish(key, values, fields[key][2], 0, False))
        return self.transform(steps) if self.transform is not None else steps

    def _index_column(self, col: str) -> NDArray[np.int64]:
        episodes = np.repeat(np.arange(len(self.lengths)), self.lengths)
        return episodes if col != "step_idx" else np.arange(len(episodes)) - self.offsets[episodes]

    def get_col_data(self, col: str) -> NDArray[Any]:
        """A whole column, ``(rows, …)``; images ``(rows, H, W, C)``. Also ``ep_idx`` and ``step_idx`` of every row."""
        fields = self._fields
        if col not in fields and col in INDICES:
            return self._index_column(col)
        self._require([col], list(fields))
        values = self.reader.column(fields[col][0])
        return np.asarray(values, dtype=object) if isinstance(values, list) else values

    def get_dim(self, col: str) -> int:
        """How many values a row of a column has."""
        self._require([col], list(self._fields))
        return int(np.prod(self._fields[col][2])) if col in self._fields else 1

    def get_row_data(self, row_idx: int | list[int]) -> dict[str, Any]:
        """Rows by their number over the whole dataset, as stored: ``(…)`` for an int, ``(len, …)`` for a list."""
        rows = to_numpy(row_idx).astype(np.int64)
        return self._rows(rows, self._keys)

    def _rows(self, rows: NDArray[np.int64], keys: list[str]) -> dict[str, Any]:
        ends = np.cumsum(self.lengths)
        size = int(ends[-1]) if len(ends) else 0
        if rows.size and not (-size <= rows.min() and rows.max() < size):
            raise IndexError(f"a row of {rows.tolist()} does not exist, there are {size}")
        flat = rows.reshape(-1) % max(size, 1)
        episodes = np.searchsorted(ends, flat, side="right")
        places = list(zip(episodes.tolist(), (flat - self.offsets[episodes]).tolist(), strict=True))
        fields = self._fields
        arrays = self.reader.gather(places, [fields[key][0] for key in keys])
        values = {
            key: np.asarray(array, dtype=object) if isinstance(array, list) else array
            for key, array in zip(keys, arrays, strict=True)
        }
        return values if rows.ndim else {key: array[0] for key, array in values.items()}

    def merge_col(self, source: list[str] | str, target: str, dim: int = -1) -> None:
        """Adds the column ``target``, in memory: the columns ``source`` joined along ``dim``."""
        if isinstance(source, str):
            source = [key for key in self._fields if re.match(source, key)]
        self._merged[target] = np.ascontiguousarray(np.concatenate([self.get_col_data(key) for key in source], axis=dim))
        if target not in self.cached_columns:
            self.cached_columns.append(target)
        if target not in self._keys:
            self._keys.append(target)
        self._reset()

    def resized(self, image_size: tuple[int, int], fit: str | None = None) -> Self:
        """The same dataset with images of another size, by area.

        Args:
            image_size: ``(H, W)``.
            fit: ``"stretch"``, ``"crop"`` (the middle) or ``"pad"`` (with black); needed where ``image_size`` has another
                shape than the images.
        """
        other = copy(self)
        other._merged = dict(self._merged)
        other._resize = (image_sides("image_size", image_size), fit)
        other._keys, other.cached_columns = list(self._keys), list(self.cached_columns)
        other._reset()
        other._reader = other._open()
        return other

    def subset(self, episodes: Sequence[int]) -> Self:
        """The same dataset with some of its episodes, in this order. Nothing is copied but merged columns."""
        if any(isinstance(episode, (bool, np.bool_)) for episode in episodes):
            raise TypeError("episodes is a mask of booleans; give the numbers of the episodes, np.flatnonzero(mask)")
        wanted = [whole_number("episodes", episode, least=-(2**63)) for episode in episodes]
        count = len(self.lengths)
        missing = [episode for episode in wanted if not 0 <= episode < count]
        if missing:
            raise IndexError(f"{self.path}: there is no episode {missing[0]}; there are {count}, counted from 0")
        if twice := [episode for episode, times in Counter(wanted).items() if times > 1]:
            logger.warning("%s: this part has episodes more than once: %s", self.path, ", ".join(map(str, twice[:9])))
        part = copy(self)
        part.episodes = wanted if self.episodes is None else [self.episodes[episode] for episode in wanted]
        starts, lengths = self.offsets[wanted], self.lengths[wanted]
        pairs: list[tuple[int, int]] = list(zip(starts.tolist(), lengths.tolist(), strict=True))
        rows = np.asarray([row for first, count in pairs for row in range(first, first + count)], dtype=np.int64)
        part._merged = {key: np.ascontiguousarray(values[rows]) for key, values in self._merged.items()}
        part._keys, part.cached_columns = list(self._keys), list(self.cached_columns)
        part._reset()
        Dataset.__init__(part, lengths, np.cumsum(lengths) - lengths, self.frameskip, self.num_steps, self.transform)
        if wanted and not len(part):
            logger.warning(
                "%s: none of the %d chosen episodes is as long as a clip (%d rows), so that this part holds none",
                self.path,
                len(wanted),
                self.span,
            )
        return part

    def statistics(self, keys: Sequence[str] | None = None, quantiles: Sequence[float] | None = None) -> dict[str, Any]:
        """Mean, std, min, max and quantiles of columns, found in one pass, by column."""
        found = json.loads(self.reader.statistics(None if keys is None else list(keys), quantiles))
        return found["columns"]

    def verify(self) -> dict[str, Any]:
        """Reads everything and compares it with the file's checksums: ``{"problems": [...], "notes": [...], …}``."""
        return json.loads(self.reader.verify())

    def __repr__(self) -> str:
        return _show.text(self)

    def _repr_html_(self) -> str:
        return _show.html(self)
