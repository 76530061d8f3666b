"""Batches of clips for training, read ahead by Rust threads: no worker processes, no pickling, no copies."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NoReturn, cast

import numpy as np

from .._arguments import device_of, kind_of, named_list, require_callable, whole_number
from .._arrays import image_sides
from .._core import core as _swm
from ._tensors import Output, Rewards, converter, require_torch, stack, sums_rewards
from .concat import ConcatDataset
from .dataset import ACTION
from .goals import GoalDataset
from .merge import MergeDataset
from .native import Clips, NativeDataset
from .utils import load_dataset
from .writers import as_column

__all__ = ["Loader", "collate"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")


def collate(items: Any) -> Any:
    """Makes a batch of clips; hand it to a ``DataLoader`` as ``collate_fn``.

    Clips that a dataset of this package has read together are a batch already and are passed on without a copy; others
    are stacked, text becomes a list.

    Example:
        >>> DataLoader(dataset, batch_size=64, shuffle=True, num_workers=4, collate_fn=swm.data.collate)
    """
    if isinstance(items, Clips):
        return items.batch
    return {key: stack([item[key] for item in items]) for key in items[0]}


def native_reader(dataset: Any) -> tuple[_swm.Reader, list[str] | None]:
    """The Rust reader of a dataset, and its columns (``None``: all)."""
    if isinstance(dataset, NativeDataset):
        if type(dataset)._load_slice is not NativeDataset._load_slice:  # pyright: ignore[reportPrivateUsage]
            raise TypeError(f"{type(dataset).__name__} has a _load_slice of its own; use torch.utils.data.DataLoader")
        return dataset.reader, dataset.column_names
    if isinstance(dataset, GoalDataset):
        return native_reader(dataset.dataset)
    if isinstance(dataset, ConcatDataset):
        parts = [native_reader(part) for part in dataset.datasets]
        keys = [key for key in dataset.column_names if all(names is None or key in names for _, names in parts)]
        return _swm.Reader.concat([reader for reader, _ in parts]), keys
    if isinstance(dataset, MergeDataset):
        readers = [native_reader(part)[0] for part in dataset.datasets]
        joined = readers[0]
        for reader, keys in zip(readers[1:], dataset.keys_map[1:], strict=True):
            taken = {name for name, *_ in joined.fields}
            twice = [key for key in keys if key in taken]
            if twice:
                raise ValueError(f"column {twice[0]!r} of MergeDataset is in an earlier dataset, too; drop it there with keys_to_load")
            joined = joined.beside(reader)
        return joined, dataset.column_names
    if hasattr(dataset, "episodes") and hasattr(dataset, "get_col_data"):  # A replay buffer: a snapshot.
        columns = [(name, as_column(name, dataset.get_col_data(name))) for name in dataset.column_names]
        return _swm.Reader.memory("replay buffer", dataset.lengths.tolist(), columns), None
    if type(dataset).__module__.startswith("torch.utils.data") and hasattr(dataset, "indices"):
        raise TypeError(
            "Loader takes whole episodes and not a Subset of clips; use swm.data.split(dataset, [0.9, 0.1]), or "
            "torch.utils.data.DataLoader(subset, collate_fn=swm.data.collate)"
        )
    raise TypeError(
        f"Loader reads datasets of this package's formats, not {type(dataset).__name__}; use torch.utils.data.DataLoader"
    )


class Loader:
    """Batches of clips, epoch after epoch: ``for batch in loader`` is one epoch, the next one the next.

    What a batch holds depends on the dataset, the seed and the epoch, not on threads or clocks. A batch stays valid as
    long as any of its tensors is held, and its memory is used again afterwards.

    Args:
        dataset: A dataset of a file or folder (or its path), a ``ConcatDataset``, ``MergeDataset`` or ``GoalDataset`` of
            such, or a ``ReplayBuffer`` (its content of this moment).
        batch_size: Clips of a batch.
        shuffle: In another order in every epoch, else in that of the dataset.
        seed: Of the order, and of goals that name no seed.
        drop_last: Leave out the last batch if it is not full.
        num_steps, frameskip, keys, image: Default: the dataset's.
        goals: ``True``, or a dict of ``probabilities`` (random, geometric, uniform, current), ``gamma``, ``offset``,
            ``keys`` and ``seed``: adds ``goal_<key>`` columns ``(B, 1, …)`` as :class:`GoalDataset` does.
        threads: That read; ``None``: one per core.
        pin_memory: Read into pinned memory of torch; default: if ``device`` is a CUDA device.
        device: Where the tensors go.
        shard: ``(rank, world)`` in distributed training: each rank gets its part of every epoch.
        ahead: Batches that each thread has ready.
        output: ``"torch"``, ``"numpy"``, or ``None``: torch if it is installed.
        transform: Changes every batch, dict to dict. A ``transform`` of the dataset is applied to every clip, which is
            slow.
        paper: The 50 starts per episode of the paper's loader.
        rewards: ``"recorded"`` or ``"action"``, beside the actions that earn them, summed over the frame skip; default: the
            dataset's, which is ``"recorded"``: row t holds the reward of arriving at t.
        float32: Give columns of 64-bit floating point in 32 bit, which is what models are planned with. False: as stored,
            which is also what an item of the dataset is.
        cache: ``"decoded"`` decodes images once, at the size of ``image``, into files in ``DATASET.decoded`` beside the
            dataset, or in ``$SWM_HOME/cache`` where nothing can be written there, and reads clips from them. Batches are
            the same. The log (level INFO) names the file and what it cost.
        cache_limit: The most bytes that it writes; default: 20 GB.

    Example:
        >>> loader = Loader("pusht.h5", batch_size=64, num_steps=4, frameskip=5, device="cuda")
        >>> for epoch in range(10):
        ...     for batch in loader:
        ...         batch["pixels"]  # uint8 (64, 4, 3, 224, 224)
        ...         batch["action"]  # float32 (64, 4, 10)
    """

    def __init__(
        self,
        dataset: Any,
        batch_size: int = 64,
        shuffle: bool = True,
        seed: int = 0,
        drop_last: bool = False,
        *,
        num_steps: int | None = None,
        frameskip: int | None = None,
        keys: Sequence[str] | None = None,
        image: tuple[int, int] | None = None,
        goals: bool | Mapping[str, Any] | None = None,
        threads: int | None = None,
        pin_memory: bool | None = None,
        device: Any = None,
        shard: tuple[int, int] = (0, 1),
        ahead: int = 2,
        output: Output = None,
        transform: Callable[[dict[str, Any]], dict[str, Any]] | None = None,
        paper: bool = False,
        rewards: Rewards | None = None,
        float32: bool = True,
        cache: Literal["decoded"] | None = None,
        cache_limit: int | None = None,
    ) -> None:
        if isinstance(dataset, (str, Path)):
            dataset = load_dataset(dataset)
        if whole_number("batch_size", batch_size, least=-(1 << 62)) < 1:
            raise _swm.DataError(f"Loader: batch_size={batch_size}: use 1 or more clips")
        whole_number("seed", seed)
        whole_number("ahead", ahead)
        if isinstance(cast("Any", shuffle), str):
            raise TypeError(f"shuffle={shuffle!r} is a text; give True or False")
        if not isinstance(cast("Any", shard), (tuple, list)) or len(shard) != 2:
            raise TypeError(f"shard={shard!r}: give (rank, world size), such as shard=(0, 2), or (0, 1) for all")
        for part in shard:
            whole_number("shard", part)
        require_callable("transform", transform, "a batch, {column: (B, T, …)}")
        image = None if image is None else image_sides("image", image)
        self.dataset = dataset
        self.batch_size = batch_size
        self.seed = seed
        self.transform = transform
        inner: Any = dataset.dataset if isinstance(dataset, GoalDataset) else dataset
        first: Any = inner.datasets[0] if hasattr(inner, "datasets") else inner
        reader, names = native_reader(dataset)
        if keys is not None and len(keys) == 0:
            raise ValueError("keys is empty; name columns, such as keys=['pixels', 'action'], or leave it out for all")
        wanted = named_list("keys", keys) if keys is not None else names
        self._goal_names: dict[str, str] = {}
        self.num_steps: int = first.num_steps if num_steps is None else num_steps
        self.frameskip: int = first.frameskip if frameskip is None else frameskip
        self._clips = _swm.ClipReader(
            reader,
            num_steps=self.num_steps,
            frameskip=self.frameskip,
            keys=wanted,
            image=image or getattr(first, "image", None),
            paper=paper,
            threads=threads,
            goals=self._goals(goals),
            action_rewards=sums_rewards(getattr(first, "rewards", "recorded") if rewards is None else rewards),
            float32=float32,
            cache_limit=_cache_limit(cache, cache_limit),
        )
        for message, is_new in self._clips.cached:
            if is_new:
                logger.info("%s", message)
        self._fields = {name: (dtype, shape) for name, dtype, shape, _ in self._clips.fields}
        self._options: dict[str, Any] = {
            "size": batch_size,
            "shuffle": seed if shuffle else None,
            "drop_last": drop_last,
            "ahead": ahead,
            "shard": tuple(shard),
        }
        self._moved = [name for name, fixed in ((name, _moves(name, *field)) for name, field in self._fields.items()) if fixed]
        self._clip_transform: Callable[[dict[str, Any]], dict[str, Any]] | None = getattr(first, "transform", None)
        if device is not None or pin_memory:
            require_torch("device= and pin_memory=")
        self.device: Any = None if device is None else device_of("device", device)
        on_gpu = output != "numpy" and self.device is not None and self.device.type == "cuda"
        self.pin_memory: bool = on_gpu if pin_memory is None else pin_memory
        self._convert = converter(output)
        self._make_table: Callable[[], tuple[dict[str, Any], Any]] | None = self._pinned if self.pin_memory else None
        self._stream = self._start(None)
        self._fresh = True
        self._turn: int = 0

    def _goals(self, goals: bool | Mapping[str, Any] | None) -> Any:
        """What the core is told of goals."""
        if isinstance(self.dataset, GoalDataset) and goals is None:
            wrapped = self.dataset
            goals = {
                "probabilities": wrapped.goal_probabilities,
                "gamma": wrapped.gamma,
                "offset": wrapped.current_goal_offset,
                "keys": list(wrapped.goal_keys),
                "seed": self.seed if wrapped.seed is None else wrapped.seed,
            }
            self._goal_names = {f"goal_{key}": name for key, name in wrapped.goal_keys.items() if name != f"goal_{key}"}
            if not wrapped.goal_keys:
                return None
        if not goals:
            return None
        asked = {} if goals is True else dict(goals)
        unknown = asked.keys() - {"probabilities", "gamma", "offset", "keys", "seed"}
        if unknown:
            raise ValueError(f"goals: unknown setting {sorted(unknown)[0]!r}; use probabilities, gamma, offset, keys and seed")
        keys = asked.get("keys")
        return (
            tuple(asked.get("probabilities", (0.3, 0.5, 0.0, 0.2))),
            float(asked.get("gamma", 0.99)),
            asked.get("offset"),
            None if keys is None else list(keys),
            int(asked.get("seed", self.seed)),
        )

    def _pinned(self) -> tuple[dict[str, Any], Any]:
        """A table of torch's own pinned tensors, which waits for copies to the GPU before it is used again."""
        torch = require_torch("pin_memory=")
        types = {"bool": torch.bool, "uint8": torch.uint8, "int32": torch.int32, "int64": torch.int64}
        types |= {"float32": torch.float32, "float64": torch.float64}
        tensors = {
            name: torch.empty((self.batch_size, *shape), dtype=types[dtype], pin_memory=torch.cuda.is_available())
            for name, (dtype, shape) in self._fields.items()
            if dtype != "str"
        }
        return {name: tensor.numpy() for name, tensor in tensors.items()}, tensors

    def _start(self, position: str | None) -> _swm.BatchStream:
        return self._clips.batches(**self._options, position=position, make_table=self._make_table)

    def __len__(self) -> int:
        """Batches of an epoch."""
        clips = len(self._clips) // self._options["shard"][1]
        return clips // self.batch_size if self._options["drop_last"] else -(-clips // self.batch_size)

    @property
    def num_clips(self) -> int:
        """Clips of the dataset."""
        return len(self._clips)

    @property
    def epoch(self) -> int:
        """The epoch that goes on, or else the next one."""
        return self._position()["epoch"]

    def _position(self) -> dict[str, Any]:
        return json.loads(self._stream.position())

    def __iter__(self) -> Iterator[dict[str, Any]]:
        if not self._fresh:
            # The last epoch was left before its end.
            self.set_epoch(self._position()["epoch"] + 1)
        self._turn += 1
        return _Epoch(self, self._turn)

    def _next(self, turn: int) -> dict[str, Any]:
        """The next batch of the iteration ``turn``."""
        if turn != self._turn:
            raise RuntimeError("another iteration of this loader has begun; make a second Loader to run two at once")
        self._fresh = False
        read = self._stream.next()
        if read is None:
            self._fresh = True
            self._turn += 1
            raise StopIteration
        return self._finish(read)

    def _finish(self, read: Any) -> dict[str, Any]:
        """A batch as the user gets it."""
        batch: dict[str, Any]
        if self._make_table is None:
            batch = {name: self._convert(values) for name, values in read.items()}
        else:
            tensors, rows, texts = read
            known = {name: tensor[:rows] for name, tensor in tensors.items()} | dict(texts)
            batch = {name: known[name] for name in self._fields}
        for name in self._moved:
            batch[name] = _move(batch[name], self._fields[name][0])
        for name, wanted in self._goal_names.items():
            batch[wanted] = batch.pop(name)
        if self._clip_transform is not None:
            batch = self._by_clip(batch)
        if self.device is not None:
            batch = {
                name: values.to(self.device, non_blocking=True) if hasattr(values, "to") else values
                for name, values in batch.items()
            }
        return self.transform(batch) if self.transform is not None else batch

    def _by_clip(self, batch: dict[str, Any]) -> dict[str, Any]:
        assert self._clip_transform is not None
        clips: list[dict[str, Any]] = []
        for at in range(len(next(iter(batch.values())))):
            clip = {name: values[at] for name, values in batch.items()}
            if ACTION in clip:
                clip[ACTION] = clip[ACTION].reshape(self.num_steps * self.frameskip, -1)
            clip = self._clip_transform(clip)
            if ACTION in clip:
                clip[ACTION] = clip[ACTION].reshape(self.num_steps, -1)
            clips.append(clip)
        return collate(clips)

    def set_epoch(self, epoch: int) -> None:
        """The next iteration is this epoch, from its start."""
        position = self._position()
        if not self._fresh or position["epoch"] != epoch or position["clip"]:
            self._restart(position | {"epoch": int(epoch), "clip": 0})

    def _restart(self, position: dict[str, Any]) -> None:
        self._stream.close()
        self._stream = self._start(json.dumps(position))
        self._fresh = True
        self._turn += 1

    def state_dict(self) -> dict[str, Any]:
        """Where it is: the next batch of a loader that loads it is the one that would come here."""
        return {"position": self._position(), "batch_size": self.batch_size}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Goes on where another loader of the same dataset and settings was."""
        if not isinstance(cast("Any", state), Mapping) or not isinstance(state.get("position"), Mapping):
            raise ValueError(f"load_state_dict was given {kind_of(state)} without the position of a loader; give what state_dict() of one returned")
        position = dict(state["position"])
        rest = self.num_clips // self._options["shard"][1]
        if self._options["drop_last"]:
            rest -= rest % self.batch_size
        if position["clip"] >= rest:
            position |= {"epoch": position["epoch"] + 1, "clip": 0}
        self._restart(position)

    def __getitem__(self, index: object) -> NoReturn:
        """None: it makes whole batches itself, in its own order."""
        raise TypeError(
            f"loader[{index!r}]: a Loader makes batches itself: iterate over it; torch.utils.data.DataLoader takes its dataset, with "
            "collate_fn=swm.data.collate"
        )

    def close(self) -> None:
        """Ends its threads; batches stay valid."""
        self._stream.close()

    def __enter__(self) -> Loader:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __reduce__(self) -> Any:
        raise TypeError("a Loader has threads and cannot be pickled; pickle its dataset, and its state_dict()")

    def __repr__(self) -> str:
        columns = ", ".join(f"{name} {dtype} {(self.batch_size, *shape)}" for name, (dtype, shape) in self._fields.items())
        return f"Loader({self.num_clips} clips, {len(self)} batches of {self.batch_size}: {columns})"


def _cache_limit(cache: str | None, limit: int | None) -> int | None:
    """The bytes of decoded images that may be written; ``None`` without a cache."""
    if cache is None:
        if limit is not None:
            raise ValueError(f"cache_limit={limit!r}: nothing is cached; give cache='decoded', too, or leave it out")
        return None
    if cache != "decoded":
        raise ValueError(f"cache={cache!r}: give 'decoded', or None to decode images for every clip")
    return 20_000_000_000 if limit is None else whole_number("cache_limit", limit)


class _Epoch(Iterator[dict[str, Any]]):
    """One pass over a loader. After a batch that cannot be read, it goes on with the next."""

    def __init__(self, loader: Loader, turn: int) -> None:
        self._loader = loader
        self._turn = turn
        self._ended = False

    def __next__(self) -> dict[str, Any]:
        if self._ended:
            raise StopIteration
        try:
            return self._loader._next(self._turn)  # pyright: ignore[reportPrivateUsage]
        except StopIteration:
            self._ended = True
            raise


def _moves(name: str, dtype: str, shape: Sequence[int]) -> bool:
    """Whether the channels are elsewhere than in the items of datasets: first if there are 1 or 3, else last."""
    if name == ACTION or len(shape) != 4:
        return False
    return shape[1] not in (1, 3) if dtype == "uint8" else shape[3] in (1, 3)


def _move(values: Any, dtype: str) -> Any:
    source, target = (2, -1) if dtype == "uint8" else (-1, 2)
    if hasattr(values, "movedim"):
        return values.movedim(source, target)
    return np.moveaxis(values, source, target)
