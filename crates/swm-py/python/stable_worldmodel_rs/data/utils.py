"""Opening, fetching, splitting, converting and merging datasets."""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import inspect
import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from .._access import access_checked, checked_access
from .._arguments import target_path, whole_number
from .._arrays import image_sides
from .._core import core as _swm
from .._progress import Progress
from .._requests import asked
from ._paths import DEFAULT_CACHE_DIR, datasets_folder, ensure_dir_exists, find_dataset, get_cache_dir
from ._tensors import to_numpy
from ._wrong import what_it_is
from .format import EPISODE_DATA_KEY, FORMATS, detect_format, get_format
from .native import OPENING, NativeDataset, as_options
from .normalization import IdentityScaler, PercentileScaler, ZScoreScaler, column_normalizer, get_scaler
from .writers import NativeWriter

__all__ = [
    "DEFAULT_CACHE_DIR",
    "IdentityScaler",
    "PercentileScaler",
    "ZScoreScaler",
    "column_normalizer",
    "convert",
    "download",
    "ensure_dir_exists",
    "get_cache_dir",
    "get_scaler",
    "load_dataset",
    "merge",
    "split",
    "split_files",
    "split_held_out",
]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")


def load_dataset(name: str | Path, cache_dir: str | Path | None = None, format: str | None = None, **kwargs: Any) -> Any:
    """Opens a dataset.

    Args:
        name: A file or folder (absolute, or below ``<cache_dir>/datasets``, or below the working directory; what begins with ``.`` or ``~``
            is a path alone), the id of a repository that :func:`download` has fetched, or ``lerobot://<repo id>``. An address, ``https://…``,
            ``s3://BUCKET/KEY`` or ``hf://datasets/USER/REPO[@REVISION]/PATH``, is read where it is, and fetched as far as it is read.
        cache_dir: Default: ``$STABLEWM_HOME``, else ``~/.stable_worldmodel``.
        format: Default: what the path says.
        **kwargs: Arguments of the reader, such as ``num_steps`` and ``frameskip``. Of a dataset of another program (DINO-WM,
            OGBench, PLDM, robomimic, LIBERO, ManiSkill, Minari, D4RL) also ``map``, ``camera``, ``flip``, ``channels``, ``fps``, ``env``,
            ``env_options``, ``split``, ``max_steps``, ``shift``, ``storage``, and of any dataset ``image_size`` with ``fit``:
            see ``options`` of :class:`NativeDataset`.

    Example:
        >>> dataset = load_dataset("pusht.h5", num_steps=4, frameskip=5, keys_to_load=["pixels", "action"])
    """
    if not isinstance(cast("Any", name), (str, os.PathLike)):
        several = "; give one, and join several by ConcatDataset" if isinstance(name, (list, tuple)) else ""
        is_open = f"; it is open already: its path is {name.path}" if isinstance(name, NativeDataset) else ""
        shown = "" if is_open else f" {name!r}"
        raise TypeError(f"load_dataset was given {type(name).__name__}{shown} in the place of a path{several}{is_open}")
    if not str(name):
        raise ValueError("load_dataset was given an empty name; give the path of a dataset, or its name below <cache_dir>/datasets")
    if _swm.is_remote(str(name)):
        return _elsewhere(str(name), format, kwargs)
    if "://" in str(name):
        known = get_format(format) if format else next((known for known in FORMATS.values() if known.detect(str(name))), None)
        own = {native for native, *_ in _swm.dataset_formats()} - {"lerobot"}
        if known is None or known.name in own:
            raise ValueError(
                f"No format detected for {str(name)!r}: of schemes, https://, s3://, hf://datasets/ and lerobot:// are known; fetch the "
                "file and give its path, or a repository of the Hub by swm.data.download(repo)"
            )
        return known.open_reader(str(name), **kwargs)
    with checked_access(name):
        return _opened(find_dataset(str(name), datasets_folder(cache_dir)), format, kwargs)


def _elsewhere(address: str, format: str | None, kwargs: dict[str, Any]) -> NativeDataset:
    if format is not None:
        raise ValueError(f"format={format!r}: the content of {address!r} tells its format; leave it out")
    options = {name: kwargs.pop(name) for name in OPENING if name in kwargs}
    if options:
        kwargs["options"] = options
    try:
        return NativeDataset(address, **kwargs)
    except TypeError as error:
        raise _unknown_argument(error, kwargs) or error from None


def _opened(path: Path, format: str | None, kwargs: dict[str, Any]) -> Any:
    known = get_format(format) if format else detect_format(path)
    options = {name: kwargs.pop(name) for name in OPENING if name in kwargs}
    if options:
        kwargs["options"] = options
    reader = NativeDataset if known is None else known.open_reader
    try:
        return reader(path, **kwargs)  # without a format, of another program
    except TypeError as error:
        raise _unknown_argument(error, kwargs) or error from None
    except _swm.DataError as error:
        if "is not a dataset" not in str(error) or known is not None:
            raise
        what = what_it_is(path) if "content is of no known format" in str(error) else None
        raise _swm.DataError(f"No format detected; {error if what is None else f'{path} is not a dataset: {what}'}") from None


def _unknown_argument(error: TypeError, given: Mapping[str, Any]) -> TypeError | None:
    """What was meant by an argument that no reader has."""
    unknown = next((name for name in given if f"unexpected keyword argument '{name}'" in str(error)), None)
    if unknown is None:
        return None
    known = [*inspect.signature(NativeDataset.__init__).parameters, *OPENING]
    near = difflib.get_close_matches(unknown, known, 1)
    hint = f"; did you mean {near[0]!r}?" if near else "; `help(swm.data.NativeDataset)` lists them"
    return TypeError(f"load_dataset has no argument {unknown!r}{hint}")


@access_checked
def download(repo: str, cache_dir: str | Path | None = None, revision: str = "main", allow_patterns: Sequence[str] | None = None) -> Path:
    """Fetches a dataset repository of the Hugging Face Hub to ``<cache_dir>/datasets/<user>--<repo>``.

    Opening a dataset never fetches anything; this does. Files that are there are not fetched again.

    Args:
        repo: ``user/repo``.
        cache_dir: As of :func:`load_dataset`, which then finds it under the same name.
        revision: Branch, tag or commit.
        allow_patterns: The files to fetch, ``["*.h5"]``; ``None``: all.
    """
    if importlib.util.find_spec("huggingface_hub") is None:
        raise ImportError("swm.data.download needs huggingface_hub; install it with `pip install huggingface_hub`")
    hub = importlib.import_module("huggingface_hub")
    folder = get_cache_dir(cache_dir, "datasets") / repo.replace("/", "--")
    hub.snapshot_download(
        repo, repo_type="dataset", revision=revision, local_dir=str(folder), allow_patterns=allow_patterns
    )
    return folder


def split(dataset: NativeDataset, fractions: Sequence[float], seed: int = 0) -> list[NativeDataset]:
    """Parts of a dataset by whole episodes, sampled at random: no clip of one part overlaps one of another.

    Args:
        dataset: A dataset of a file or folder.
        fractions: Of the episodes, ``[0.9, 0.1]``; they sum to 1 or less.
        seed: Of the choice.
    """
    if not isinstance(cast("Any", dataset), NativeDataset):
        raise TypeError(f"split divides a dataset, not {dataset!r}; open it first: split(load_dataset(…), [0.9, 0.1])")
    if isinstance(cast("Any", fractions), (int, float)):
        raise TypeError(f"fractions={fractions!r}: give one for each part, such as [0.9, 0.1]")
    if any(isinstance(part, bool) or not isinstance(cast("Any", part), (int, float, np.number)) for part in fractions):
        raise TypeError(f"fractions={list(fractions)!r}: give parts of 1 as numbers, such as [0.9, 0.1]")
    if not 0 < sum(fractions) <= 1 + 1e-9 or min(fractions) < 0:
        raise ValueError(f"fractions {list(fractions)} must be 0 or more and sum to at most 1")
    order = np.random.default_rng(whole_number("seed", seed, most=(1 << 64) - 1)).permutation(len(dataset.lengths))
    ends = np.rint(np.cumsum([0.0, *fractions]) * len(order)).astype(int)
    for share, first, end in zip(fractions, ends[:-1], ends[1:], strict=True):
        if share > 0 and first == end:
            logger.warning("%s: the part of %g has none of the %d episodes; give it a larger fraction", dataset.path, share, len(order))
    return [dataset.subset(np.sort(order[first:end]).tolist()) for first, end in zip(ends[:-1], ends[1:], strict=True)]


def split_held_out(dataset: NativeDataset, share: float = 0.2) -> tuple[NativeDataset, NativeDataset]:
    """The episodes to train on, and those that moderate and strict manifests of the file take their pairs from.

    The choice depends on the position of an episode in its file alone, so every program makes the same.

    Args:
        dataset: A dataset of a file or folder.
        share: As ``held_out`` of :func:`make_manifest`.
    """
    if not 0 <= share <= 1:
        raise ValueError(f"a share of {share} of the episodes; use 0 to 1")
    positions = list(range(len(dataset.lengths))) if dataset.episodes is None else list(dataset.episodes)
    held = _swm.held_out(positions, share)
    training, evaluation = ([at for at, is_held in enumerate(held) if is_held == part] for part in (False, True))
    return dataset.subset(training), dataset.subset(evaluation)


@access_checked
def convert(
    source: str | Path,
    dest: str | Path,
    *,
    source_format: str | None = None,
    dest_format: str | None = None,
    cache_dir: str | Path | None = None,
    progress: bool = True,
    opening: Mapping[str, Any] | None = None,
    image_size: tuple[int, int] | None = None,
    fit: str | None = None,
    **dest_kwargs: Any,
) -> None:
    """Copies a dataset into another format. A conversion that was interrupted goes on where it ended.

    Args:
        source: As of :func:`load_dataset`.
        dest: The new file or folder.
        source_format: Default: what the path says.
        dest_format: Default: what the file extension says, else ``"hdf5"``.
        cache_dir: As of :func:`load_dataset`.
        progress: Show a progress bar.
        opening: How a source of another program is opened: ``{"camera": "wrist"}``; see ``options`` of :class:`NativeDataset`.
        image_size: ``(H, W)`` of the images: those of datasets of other programs, and with ``fit`` all, are resized, by area;
            those of recordings of this package are rendered by replaying the episodes.
        fit: ``"stretch"``, ``"crop"`` (the middle) or ``"pad"`` (with black); needed where ``image_size`` has another shape
            than the images.
        **dest_kwargs: Arguments of the writer, such as ``mode`` and ``quality``.

    Example:
        >>> convert("pusht.h5", "pusht_video", dest_format="video")
    """
    dataset = load_dataset(source, cache_dir=cache_dir, format=source_format, **dict(opening or {}))
    request = _copy_request([dataset], dest, dest_format, opening, image_size, fit, dest_kwargs)
    if request is not None:
        path, dataset = dataset.path, None
        asked("convert", {"source": str(path), "target": str(dest), **request}, progress)
        return
    _check_size([dataset], image_size, fit)
    _copy([dataset if image_size is None else dataset.resized(image_size, fit)], dest, dest_format, progress, dest_kwargs)


@access_checked
def merge(
    sources: Sequence[str | Path],
    dest: str | Path,
    *,
    dest_format: str | None = None,
    source_formats: Sequence[str | None] | None = None,
    mode: str = "error",
    cache_dir: str | Path | None = None,
    progress: bool = True,
    opening: Mapping[str, Any] | None = None,
    image_size: tuple[int, int] | None = None,
    fit: str | None = None,
    partial: bool = False,
    **dest_kwargs: Any,
) -> None:
    """Copies the episodes of several datasets, one after the other, into one.

    Args:
        sources: Two or more, as of :func:`load_dataset`, with equal columns; of recordings of one environment, factors of
            variation may differ: one that a recording did not vary is filled in.
        dest: The new file or folder.
        dest_format: As of :func:`convert`.
        source_formats: One per source.
        mode: ``"error"`` refuses a ``dest`` that exists, ``"overwrite"`` replaces it, ``"append"`` continues it.
        cache_dir: As of :func:`load_dataset`.
        progress: Show a progress bar.
        opening: As of :func:`convert`; for each of the sources.
        image_size: As of :func:`convert`.
        fit: As of :func:`convert`.
        partial: Join parts of divided recordings as they are: in the given order, whether or not others are missing.
        **dest_kwargs: Arguments of the writer.
    """
    if isinstance(sources, (str, Path)):
        raise TypeError(f"merge takes a list of datasets: [{str(sources)!r}, …]")
    if len(sources) < 2:
        raise ValueError(f"merge needs at least two source datasets, not {len(sources)}")
    formats = list(source_formats) if source_formats is not None else [None] * len(sources)
    if len(formats) != len(sources):
        raise ValueError(f"source_formats must align with sources: {len(formats)} for {len(sources)}")
    pairs = zip(sources, formats, strict=True)
    how = dict(opening or {})
    datasets = [load_dataset(source, cache_dir=cache_dir, format=known, **how) for source, known in pairs]
    for names, what in (("column_names", "column"), ("episode_column_names", "episode-data column")):
        first = _joined_names(datasets[0], names, image_size is not None)
        for source, dataset in zip(sources, datasets, strict=True):
            here = _joined_names(dataset, names, image_size is not None)
            if here != first:
                missing, more = sorted(first - here), sorted(here - first)
                raise ValueError(f"merge: {what} mismatch of {sources[0]} and {source}: missing {missing}; unexpected {more}")
    options = dest_kwargs | {"mode": mode}
    is_new = mode != "append" or not target_path("dest", dest).exists()
    request = _copy_request(datasets, dest, dest_format, opening, image_size, fit, options) if is_new else None
    if request is not None:
        paths = [str(dataset.path) for dataset in datasets]
        datasets.clear()
        asked("merge", {"sources": paths, "out": str(dest), "partial": partial, **request}, progress)
        return
    _check_size(datasets, image_size, fit)
    if image_size is not None:
        datasets = [dataset.resized(image_size, fit) for dataset in datasets]
    _copy(datasets, dest, dest_format, progress, options)


def _joined_names(dataset: Any, names: str, rendered: bool) -> set[str]:
    """Names that datasets have to share so that they can be joined: with images that are rendered, not those of images and of what they are rendered from."""
    free = {"pixels", "goal", "checkpoint"} if rendered else set[str]()
    return {name for name in getattr(dataset, names, []) if not name.startswith("variation.") and name not in free}


@access_checked
def split_files(
    source: str | Path,
    out: str | Path,
    *,
    parts: Mapping[str, float] | None = None,
    seed: int = 0,
    dest_format: str | None = None,
    cache_dir: str | Path | None = None,
    progress: bool = True,
    opening: Mapping[str, Any] | None = None,
    image_size: tuple[int, int] | None = None,
    fit: str | None = None,
    **dest_kwargs: Any,
) -> dict[str, Path]:
    """Divides a dataset at random into files or folders of whole episodes; :func:`split` divides it without a copy.

    Args:
        source: As of :func:`load_dataset`; of a format of this package, or of another program.
        out: The files or folders to write, with ``{}`` for the name of the part.
        parts: Names and fractions, which need not sum to 1; None: ``{"train": 0.9, "val": 0.1}``.
        seed: Of the division.
        dest_format: As of :func:`convert`.
        cache_dir: As of :func:`load_dataset`.
        progress: Show a progress bar for each part.
        opening: As of :func:`convert`.
        image_size: As of :func:`convert`.
        fit: As of :func:`convert`.
        **dest_kwargs: Arguments of the writer.

    Returns:
        The file or folder of each part.

    Example:
        >>> split_files("pusht.h5", "pusht_{}.h5", parts={"train": 8, "val": 1, "test": 1}, seed=7)
    """
    shares = {"train": 0.9, "val": 0.1} if parts is None else dict(parts)
    dataset = load_dataset(source, cache_dir=cache_dir, **dict(opening or {}))
    request = _copy_request([dataset], out, dest_format, opening, image_size, fit, dest_kwargs, "out")
    if request is None:
        raise TypeError(f"{source} is not read by this package; convert it, and divide the copy")
    path, dataset = dataset.path, None
    named = [f"{name}={float(share)}" for name, share in shares.items()]
    asked("split", {"source": str(path), "out": str(out), "parts": named, "seed": seed, **request}, progress)
    return {name: Path(str(out).replace("{}", name)) for name in shares}


def _check_size(datasets: list[Any], image_size: tuple[int, int] | None, fit: str | None) -> None:
    if image_size is None and fit is not None:
        raise ValueError(f"fit={fit!r}: no image is resized; give image_size=(64, 64), or leave it out")
    if image_size is not None and not all(isinstance(dataset, NativeDataset) for dataset in datasets):
        raise TypeError("image_size: these images are not read by this package; convert them without, then again")


def _format_of(dest: Path, dest_format: str | None) -> str:
    by_suffix = {f".{suffix}": name for name, _, suffixes in _swm.dataset_formats() for suffix in suffixes}
    if dest_format is None and dest.suffix and dest.suffix not in by_suffix:
        try:
            get_format(dest.suffix[1:])
        except ValueError as error:
            raise ValueError(f"{dest}: {error}; end the name with one of {', '.join(by_suffix)}, or give dest_format=\"hdf5\"") from None
        return dest.suffix[1:]
    return dest_format or by_suffix.get(dest.suffix, "hdf5")


def _copy_request(
    datasets: list[Any],
    dest: str | Path,
    dest_format: str | None,
    opening: Mapping[str, Any] | None,
    image_size: tuple[int, int] | None,
    fit: str | None,
    options: dict[str, Any],
    of: str = "dest",
) -> dict[str, Any] | None:
    """The settings of a copy that the core makes; None where a format of Python code takes part. ``of``: the argument that ``dest`` is."""
    target = target_path(of, dest)
    name = _format_of(target, dest_format)
    sides = None if image_size is None else image_sides("image_size", image_size)
    for wrong, right in (("format", "dest_format"), ("overwrite", "mode='overwrite'")):
        if wrong in options:
            raise TypeError(f"{wrong}={options[wrong]!r} is no argument; give {right}{'' if '=' in right else f'={options[wrong]!r}'}")
    probe = get_format(name).open_writer(target, **options)
    native = isinstance(probe, NativeWriter) and all(isinstance(dataset, NativeDataset) for dataset in datasets)
    if not native or any(dataset.episode_column_names or not _is_detected(dataset) for dataset in datasets):
        return None
    if probe.mode == "error" and target.exists():
        raise FileExistsError(f"{target} already exists; use mode='overwrite' to replace it")
    request: dict[str, Any] = {
        "format": name,
        "opening": as_options(opening or {}),
        "overwrite": probe.mode == "overwrite",
        "quality": probe.quality,
        # A default is no answer where the rate of rows is in doubt.
        "fps": probe.fps if "fps" in options else None,
        "key_frames": probe.key_frame_period,
        "last_row": probe.last_row,
        "image_size": None if sides is None else {"height": sides[0], "width": sides[1]},
        "fit": fit,
    }
    return {setting: value for setting, value in request.items() if value is not None}


def _is_detected(dataset: NativeDataset) -> bool:
    """Whether the content of a dataset tells its format, so that its path is all that the core needs."""
    known = {name for name, *_ in _swm.dataset_formats()}
    # Datasets of other programs are known by their content alone.
    return dataset.reader.format not in known or _swm.detect_dataset(dataset.path) in (None, dataset.reader.format)


def _copy(datasets: list[Any], dest: str | Path, dest_format: str | None, progress: bool, options: dict[str, Any]) -> None:
    """Copies all episodes, one by one."""
    target = Path(dest).expanduser()
    name = _format_of(target, dest_format)
    known = get_format(name)
    keeps = known.supports_episode_data
    lost = sorted({name for dataset in datasets for name in getattr(dataset, "episode_column_names", [])})
    if lost and not keeps:
        logger.warning("format %r does not support episode data; %s are left out", name, lost)
    total = sum(len(dataset.lengths) for dataset in datasets)
    with Progress(f"-> {name}", total, progress) as bar, known.open_writer(target, **options) as writer:
        writer.write_episodes(_episodes(datasets, keeps, lambda done: bar.tick(done, 0, 0)))


def _episodes(datasets: list[Any], keeps: bool, advance: Callable[[int], None]) -> Iterator[dict[str, Any]]:
    done = 0
    for dataset in datasets:
        texts: dict[str, Any] = {}
        for episode, length in enumerate(np.asarray(dataset.lengths).tolist()):
            read = dataset.load_episode(episode)
            if isinstance(dataset, NativeDataset):
                # A whole episode has the text of its first row alone.
                for name in [name for name, value in read.items() if isinstance(value, str)]:
                    if name not in texts:
                        texts[name] = dataset.get_col_data(name)
                    first = int(dataset.offsets[episode])
                    read[name] = texts[name][first : first + length]
            columns = as_written(read, length)
            if keeps and getattr(dataset, "episode_column_names", None):
                once = dataset.get_episode_data([episode])
                columns[EPISODE_DATA_KEY] = {name: values[0] for name, values in once.items()}
            yield columns
            done += 1
            advance(done)


def as_written(episode: dict[str, Any], length: int) -> dict[str, Any]:
    """An episode of a reader as writers take it: images ``(T, H, W, C)`` uint8, text once per row."""
    columns: dict[str, Any] = {}
    for name, values in episode.items():
        if not hasattr(values, "shape"):
            columns[name] = [values] * length
            continue
        array: Any = to_numpy(values)
        if array.ndim == 4 and array.shape[1] in (1, 3):
            array = array.transpose(0, 2, 3, 1)
        if array.ndim == 4 and array.shape[-1] in (1, 3) and array.dtype.kind == "f":
            array = (np.clip(array, 0, 1) * 255).astype(np.uint8)
        columns[name] = list(array)
    return columns
