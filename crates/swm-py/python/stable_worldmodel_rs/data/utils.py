"""Finding, fetching, splitting, converting and merging datasets."""

from __future__ import annotations

import importlib
import importlib.util
import logging
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .._core import core as _swm
from ._paths import DEFAULT_CACHE_DIR, ensure_dir_exists, get_cache_dir
from ._tensors import to_numpy
from .format import EPISODE_DATA_KEY, FORMATS, detect_format, get_format
from .native import NativeDataset
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
    "split_held_out",
]

_OPENING = ("map", "camera", "flip", "fps", "env", "env_options", "split", "max_steps", "shift", "storage")
"""Arguments of :func:`load_dataset` that say how a dataset of another program is opened."""
logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")


def load_dataset(name: str | Path, cache_dir: str | Path | None = None, format: str | None = None, **kwargs: Any) -> Any:
    """Opens a dataset.

    Args:
        name: A file or folder (absolute, or below ``<cache_dir>/datasets``, or below the working directory), the id of a
            repository that :func:`download` has fetched, or ``lerobot://<repo id>``. An address, ``https://…``, ``s3://BUCKET/KEY``
            or ``hf://datasets/USER/REPO[@REVISION]/PATH``, is read where it is, and fetched as far as it is read.
        cache_dir: Default: ``$STABLEWM_HOME``, else ``~/.stable_worldmodel``.
        format: Default: what the path says.
        **kwargs: Arguments of the reader, such as ``num_steps`` and ``frameskip``. Of a dataset of another program (DINO-WM,
            OGBench, PLDM, robomimic, LIBERO, ManiSkill, Minari, D4RL) also ``map``, ``camera``, ``flip``, ``fps``, ``env``,
            ``env_options``, ``split``, ``max_steps``, ``shift``, ``storage``: see ``options`` of :class:`NativeDataset`.

    Example:
        >>> dataset = load_dataset("pusht.h5", num_steps=4, frameskip=5, keys_to_load=["pixels", "action"])
    """
    if _swm.is_remote(str(name)):
        if format is not None:
            raise ValueError(f"format={format!r}: the content of {str(name)!r} tells its format; leave it out")
        options = {name: kwargs.pop(name) for name in _OPENING if name in kwargs}
        return NativeDataset(str(name), **kwargs, **({"options": options} if options else {}))
    if "://" in str(name):
        known = get_format(format) if format else next((known for known in FORMATS.values() if known.detect(str(name))), None)
        if known is None:
            raise ValueError(f"No format detected for {str(name)!r}; of schemes, https://, s3://, hf:// and lerobot:// are known")
        return known.open_reader(str(name), **kwargs)
    path = _find(str(name), get_cache_dir(cache_dir, "datasets"))
    known = get_format(format) if format else detect_format(path)
    options = {name: kwargs.pop(name) for name in _OPENING if name in kwargs}
    if options:
        kwargs["options"] = options
    if known is None:
        try:
            return NativeDataset(path, **kwargs)  # of another program
        except _swm.DataError as error:
            if "is not a dataset" not in str(error):
                raise
            raise ValueError(f"No format detected; {error}") from None  # names what it is
    return known.open_reader(path, **kwargs)


def _find(name: str, datasets: Path) -> Path:
    for place in (datasets / name, Path(name)):
        if place.exists():
            return place
    if "/" in name and not name.startswith((".", "/")):
        fetched = datasets / name.replace("/", "--")
        if fetched.is_dir() and any(fetched.iterdir()):
            return fetched
        raise FileNotFoundError(f"{name!r} is neither in {datasets} nor here; fetch it with swm.data.download({name!r})")
    raise FileNotFoundError(f"{name!r} is neither in {datasets} nor a path")


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
    if not 0 < sum(fractions) <= 1 + 1e-9 or min(fractions) < 0:
        raise ValueError(f"fractions {list(fractions)} must be 0 or more and sum to at most 1")
    order = np.random.default_rng(seed).permutation(len(dataset.lengths))
    ends = np.rint(np.cumsum([0.0, *fractions]) * len(order)).astype(int)
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


@contextmanager
def _progress(shown: bool, total: int, title: str) -> Generator[Callable[[int], None], None, None]:
    """A function that is told how many episodes are done, and shows it by tqdm where that is installed."""
    if not shown or importlib.util.find_spec("tqdm") is None:
        yield lambda done: None
        return
    with importlib.import_module("tqdm.auto").tqdm(total=total, desc=title, unit=" episodes") as bar:
        yield lambda done: bar.update(done - bar.n)


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
        image_size: ``(H, W)`` to which images are resized, by area.
        fit: ``"stretch"``, ``"crop"`` (the middle) or ``"pad"`` (with black); needed where ``image_size`` has another shape
            than the images.
        **dest_kwargs: Arguments of the writer, such as ``mode`` and ``quality``.

    Example:
        >>> convert("pusht.h5", "pusht_video", dest_format="video")
    """
    how = dict(opening or {})
    dataset = load_dataset(source, cache_dir=cache_dir, format=source_format, **how)
    if image_size is not None:
        if not isinstance(dataset, NativeDataset):
            raise TypeError(f"image_size: images of {source} are not read by this package; convert it without, then again")
        dataset = dataset.resized(image_size, fit)
    elif fit is not None:
        raise ValueError(f"fit={fit!r}: no image is resized; give image_size=(64, 64), or leave it out")
    _copy([dataset], dest, dest_format, progress, dest_kwargs, True)


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
    **dest_kwargs: Any,
) -> None:
    """Copies the episodes of several datasets, one after the other, into one.

    Args:
        sources: Two or more, as of :func:`load_dataset`, with equal columns.
        dest: The new file or folder.
        dest_format: As of :func:`convert`.
        source_formats: One per source.
        mode: ``"error"`` refuses a ``dest`` that exists, ``"overwrite"`` replaces it, ``"append"`` continues it.
        cache_dir: As of :func:`load_dataset`.
        progress: Show a progress bar.
        opening: As of :func:`convert`; for each of the sources.
        **dest_kwargs: Arguments of the writer.
    """
    if len(sources) < 2:
        raise ValueError(f"merge needs at least two source datasets, not {len(sources)}")
    formats = list(source_formats) if source_formats is not None else [None] * len(sources)
    if len(formats) != len(sources):
        raise ValueError(f"source_formats must align with sources: {len(formats)} for {len(sources)}")
    pairs = zip(sources, formats, strict=True)
    how = dict(opening or {})
    datasets = [load_dataset(source, cache_dir=cache_dir, format=known, **how) for source, known in pairs]
    for names, what in (("column_names", "column"), ("episode_column_names", "episode-data column")):
        first = set(getattr(datasets[0], names, []))
        for source, dataset in zip(sources, datasets, strict=True):
            here = set(getattr(dataset, names, []))
            if here != first:
                missing, more = sorted(first - here), sorted(here - first)
                raise ValueError(f"merge: {what} mismatch of {sources[0]} and {source}: missing {missing}; unexpected {more}")
    _copy(datasets, dest, dest_format, progress, dest_kwargs | {"mode": mode}, False)


def _copy(
    datasets: list[Any], dest: str | Path, dest_format: str | None, progress: bool, options: dict[str, Any], resumes: bool
) -> None:
    """Copies all episodes: by the core if all formats are its own, else episode by episode."""
    target = Path(dest)
    if dest_format is None:
        by_suffix = {f".{suffix}": name for name, _, suffixes in _swm.dataset_formats() for suffix in suffixes}
        dest_format = by_suffix.get(target.suffix, "hdf5")
    known = get_format(dest_format)
    total = sum(len(dataset.lengths) for dataset in datasets)
    with _progress(progress, total, f"-> {dest_format}") as advance:
        probe = known.open_writer(target, **options)
        native = isinstance(probe, NativeWriter) and all(isinstance(dataset, NativeDataset) for dataset in datasets)
        native = native and not any(dataset.episode_column_names for dataset in datasets)
        if native and (resumes or options.get("mode") != "append" or not target.exists()):
            if probe.mode == "error" and target.exists():
                raise FileExistsError(f"{target} already exists; use mode='overwrite' to replace it")
            target.parent.mkdir(parents=True, exist_ok=True)
            _swm.copy_datasets(
                [dataset.reader for dataset in datasets],
                target,
                dest_format,
                mode=probe.mode,
                quality=probe.quality,
                # A default is no answer where the rate of rows is in doubt.
                fps=probe.fps if "fps" in options else None,
                key_frame_period=probe.key_frame_period,
                progress=advance,
            )
            return
        keeps = known.supports_episode_data
        lost = sorted({name for dataset in datasets for name in getattr(dataset, "episode_column_names", [])})
        if lost and not keeps:
            logger.warning("format %r does not support episode data; %s are left out", dest_format, lost)
        with probe as writer:
            writer.write_episodes(_episodes(datasets, keeps, advance))


def _episodes(datasets: list[Any], keeps: bool, advance: Callable[[int], None]) -> Iterator[dict[str, Any]]:
    done = 0
    for dataset in datasets:
        for episode, length in enumerate(np.asarray(dataset.lengths).tolist()):
            columns = as_written(dataset.load_episode(episode), length)
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
