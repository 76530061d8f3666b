"""What datasets hold: columns, runs, statistics, images; whether they are sound, and how two differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .._access import access_checked
from .._arguments import as_json, chosen_episodes, named_list, path_of, whole_number
from .._arrays import image_sides
from .._requests import asked
from ._paths import dataset_place
from .native import as_options

__all__ = ["diff", "inspect", "preview", "stats", "verify"]


@access_checked
def inspect(
    source: str | Path, *, cache_dir: str | Path | None = None, opening: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """What a dataset holds. The same as the command ``inspect``.

    Args:
        source: As of :func:`load_dataset`.
        cache_dir: As of :func:`load_dataset`.
        opening: As of :func:`convert`.

    Returns:
        ``format``, ``episodes``, ``steps``; ``columns``, the ``dtype`` and ``shape`` of a row by name; ``episode_lengths`` (``min``,
        ``max``); ``metadata`` and ``runs``, how it was made; ``skipped``, columns that are left out, with the reason; ``mapping``, names
        in files of other programs; ``notes``; ``checkpoint_rows`` of a recording without images.

    Raises:
        SwmError: It is no dataset, or cannot be read.

    Example:
        >>> inspect("pusht.h5")["columns"]["action"]  # doctest: +SKIP
        {'dtype': 'f32', 'shape': [2]}
    """
    request = {"dataset": dataset_place("source", source, cache_dir), "opening": as_options(opening or {})}
    return dict(asked("inspect", request))


@access_checked
def stats(
    source: str | Path,
    columns: Sequence[str] | None = None,
    quantiles: Sequence[float] | None = None,
    *,
    store: bool = True,
    cache_dir: str | Path | None = None,
    opening: Mapping[str, Any] | None = None,
    threads: int | None = None,
) -> dict[str, Any]:
    """Mean, standard deviation, extremes and quantiles of columns, found in one pass. The same as the command ``stats``.

    Args:
        source: As of :func:`load_dataset`.
        columns: Only these; None: all but texts.
        quantiles: Each from 0 to 1; None: 0.01, 0.05, 0.25, 0.5, 0.75, 0.95 and 0.99.
        store: Whether they are kept in ``<source>.stats.json``, where the loader's normalization looks for them, and taken from there.
        cache_dir: As of :func:`load_dataset`.
        opening: As of :func:`convert`.
        threads: Threads; None: one per core. Results do not depend on it.

    Returns:
        ``episodes``, ``rows`` and ``columns``, a dict by name: ``rows`` that count, ``not_finite`` (rows that do not), and lists over the
        values of a row, of images over channels: ``mean``, ``std`` (of the population), ``min``, ``max`` and ``quantiles``, pairs of a level
        and its values.

    Raises:
        SwmError: A setting is wrong, or the dataset cannot be read.

    Example:
        >>> stats("pusht.h5", ["action"])["columns"]["action"]["std"]  # doctest: +SKIP
        [0.41, 0.39]
    """
    request = {
        "dataset": dataset_place("source", source, cache_dir),
        "columns": None if columns is None else named_list("columns", columns),
        "quantiles": None if quantiles is None else as_json("quantiles", quantiles),
        "store": store,
        "opening": as_options(opening or {}),
        "threads": None if threads is None else whole_number("threads", threads),
    }
    return dict(asked("stats", request))


@access_checked
def verify(
    source: str | Path,
    *,
    fix: bool = False,
    dry_run: bool = False,
    cache_dir: str | Path | None = None,
    progress: bool = True,
    opening: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Reads all of a dataset and reports what is wrong with it, as the command ``verify`` does.

    Args:
        source: As of :func:`load_dataset`, of a format of this package, or of another program.
        fix: Repair what an interrupted recording left, then check.
        dry_run: With ``fix``: only report what would be done.
        cache_dir: As of :func:`load_dataset`.
        progress: Show a progress bar.
        opening: As of :func:`convert`.

    Returns:
        ``ok``; ``fixed`` and ``to_fix``, steps of a repair; ``report``: ``problems``, ``notes`` and counts.
    """
    path = dataset_place("source", source, cache_dir)
    request = {"dataset": path, "fix": fix, "dry_run": dry_run, "opening": as_options(opening or {})}
    return dict(asked("verify", request, progress))


@access_checked
def preview(
    source: str | Path,
    out: str | Path,
    episodes: Sequence[int] | str | None = None,
    *,
    column: str = "pixels",
    frames: int | None = None,
    image_size: tuple[int, int] | None = None,
    cache_dir: str | Path | None = None,
    progress: bool = True,
    opening: Mapping[str, Any] | None = None,
    threads: int | None = None,
) -> dict[str, Any]:
    """Shows episodes as a sheet of images, a row each with its goal first, or as a video in which they play side by side.

    The same as the command ``preview``. Images of a recording without images are rendered by replaying the episodes.

    Args:
        source: As of :func:`load_dataset`.
        out: The file to write: ``.png``, ``.mp4`` or ``.gif``. One that exists is replaced.
        episodes: Which, by number, or ``"0..16"``; None: the first 16.
        column: The column of images.
        frames: Images per episode; None: 8 for a sheet, at most 300 for a video.
        image_size: ``(H, W)``, to render images of this size in place of recorded ones; None: ``(128, 128)`` where there are none.
        cache_dir: As of :func:`load_dataset`.
        progress: Show a progress bar.
        opening: As of :func:`convert`.
        threads: Threads; None: one per core. Results do not depend on it.

    Returns:
        ``out``, ``episodes`` and ``frames``, the images of the longest one.

    Raises:
        SwmError: A setting is wrong, or the dataset has no images and names no environment that could render them.

    Example:
        >>> preview("pusht.h5", "sheet.png", "0..4")["frames"]  # doctest: +SKIP
        8
    """
    size = None if image_size is None else image_sides("image_size", image_size)
    request = {
        "dataset": dataset_place("source", source, cache_dir),
        "column": column,
        "opening": as_options(opening or {}),
        "out": path_of("out", out, "the path of a file"),
        "episodes": chosen_episodes(episodes),
        "frames": None if frames is None else whole_number("frames", frames),
        "image_size": None if size is None else {"height": size[0], "width": size[1]},
        "threads": None if threads is None else whole_number("threads", threads),
    }
    return dict(asked("preview", request, progress))


@access_checked
def diff(
    first: str | Path,
    second: str | Path,
    *,
    tolerance: float = 0.0,
    columns: Sequence[str] | None = None,
    ignore: Sequence[str] | None = None,
    cache_dir: str | Path | None = None,
    progress: bool = True,
    opening: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Compares two datasets of any formats, episode by episode at its place. The same as the command ``diff``.

    Args:
        first: As of :func:`load_dataset`.
        second: Another one.
        tolerance: Largest accepted absolute difference of values.
        columns: Only these; None: all.
        ignore: All columns but these.
        cache_dir: As of :func:`load_dataset`.
        progress: Show a progress bar.
        opening: As of :func:`convert`, of ``first``.

    Returns:
        ``equal``; ``episodes``, how many the first and the second have; ``schema``, columns that one of them lacks; ``lengths``, the
        episodes of different lengths; ``columns``, a dict each: ``name``, ``rows`` that differ, the ``largest`` difference, ``first``
        (episode and row) and, of images, ``psnr`` in dB.

    Raises:
        SwmError: A setting is wrong, or a dataset cannot be read.

    Example:
        >>> diff("pusht.h5", "pusht.video", ignore=["pixels"])["equal"]  # doctest: +SKIP
        True
    """
    request = {
        "first": dataset_place("first", first, cache_dir),
        "second": dataset_place("second", second, cache_dir),
        "tolerance": as_json("tolerance", tolerance),
        "columns": named_list("columns", columns or []),
        "ignore": named_list("ignore", ignore or []),
        "opening": as_options(opening or {}),
    }
    return dict(asked("diff", request, progress))
