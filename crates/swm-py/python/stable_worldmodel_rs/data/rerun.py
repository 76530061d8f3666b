"""Episodes as a recording of Rerun (``.rrd``): images, actions and all other numbers by step."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arguments import target_path
from ._tensors import to_numpy

# Wider columns are no curves that anybody reads; simulator states may have thousands of values.
_MOST_CURVES = 64
logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")


def to_rerun(
    data: Any,
    path: str | os.PathLike[str],
    *,
    episodes: Sequence[int] | None = None,
    columns: Sequence[str] | None = None,
    fps: float | None = None,
) -> Path:
    """Write episodes to a recording that ``rerun FILE`` shows. It needs the package ``rerun-sdk``.

    Each column of an episode is an entity, ``episode_3/pixels``. All episodes begin at step 0 of the timeline ``step``, so that
    they are seen side by side. Images (uint8, of 1, 3 or 4 channels) are shown as such, other numbers as one curve per value;
    columns of texts and of more than 64 values are left out, and a log record names them.

    Args:
        data: A dataset, or one episode as arrays by name, ``(T, …)``: also a plan, such as ``{"plan": actions}``.
        path: The file to write, ``.rrd``; one that exists is replaced.
        episodes: Which episodes of a dataset; None: all.
        columns: Which columns; None: all that can be shown.
        fps: Steps per second, for the timeline ``time``; None: there is none.

    Returns:
        The file.

    Raises:
        ImportError: ``rerun-sdk`` is not installed.
        ValueError: A column or an episode that is not there, ``fps`` that is not above 0, or nothing to show.

    Example:
        >>> swm.data.to_rerun(swm.data.load_dataset("pusht.h5"), "pusht.rrd", episodes=[0, 1], fps=10)
    """
    file = target_path("path", path)
    if file.suffix != ".rrd":
        raise ValueError(f"path={str(path)!r} is no name of a recording; end it with .rrd")
    if fps is not None and not fps > 0:
        raise ValueError(f"fps={fps} must be above 0")
    rerun = _library()
    # A recording takes the place of an older one when it is whole.
    draft = file.with_name(f".{file.stem}.{os.getpid()}.rrd")
    try:
        skipped = _write(rerun, draft, file.stem, _entities(data, episodes, columns), fps)
        os.replace(draft, file)
    finally:
        draft.unlink(missing_ok=True)
    if skipped:
        logger.info("%s: left out %s, which hold texts or more than %s values", file, ", ".join(skipped), _MOST_CURVES)
    return file


def _write(rerun: Any, file: Path, name: str, entities: Iterator[tuple[str, NDArray[Any]]], fps: float | None) -> list[str]:
    """Writes a recording; the columns that cannot be shown."""
    recording = rerun.RecordingStream(name)
    recording.save(file)
    skipped: set[str] = set()
    shown = 0
    for entity, values in entities:
        content = _content(rerun, values)
        if content is None:
            skipped.add(entity.rpartition("/")[2])
            continue
        steps = np.arange(len(values))
        timelines = [rerun.TimeColumn("step", sequence=steps)]
        if fps is not None:
            timelines.append(rerun.TimeColumn("time", duration=steps / fps))
        recording.send_columns(entity, timelines, content)
        shown += 1
    recording.disconnect()
    if not shown:
        raise ValueError(f"nothing to show: no images, and no numbers of at most {_MOST_CURVES} values, in {sorted(skipped)}")
    return sorted(skipped)


def _library() -> Any:
    try:
        return import_module("rerun")
    except ImportError as error:
        raise ImportError("recordings of Rerun need the package rerun-sdk; install it with `pip install rerun-sdk`") from error


def _entities(data: Any, episodes: Sequence[int] | None, columns: Sequence[str] | None) -> Iterator[tuple[str, NDArray[Any]]]:
    """Name and values, ``(T, …)``, of each column of each episode."""
    single = isinstance(data, Mapping)
    names: list[str] = list(data) if single else list(data.column_names)  # pyright: ignore[reportUnknownArgumentType]
    for column in columns or ():
        if column not in names:
            raise ValueError(f"columns={list(columns or ())}: there is no {column!r}; there are {', '.join(names)}")
    if single:
        if episodes is not None:
            raise ValueError("episodes= chooses among those of a dataset; leave it out for arrays")
        yield from ((name, to_numpy(data[name])) for name in columns or names)
        return
    count = len(data.lengths)
    for index in range(count) if episodes is None else episodes:
        if not 0 <= index < count:
            raise ValueError(f"episodes={list(episodes or ())}: there is no {index}; there are 0 to {count - 1}")
        episode = data.load_episode(index)
        yield from ((f"episode_{index}/{name}", to_numpy(episode[name])) for name in columns or names)


def _content(rerun: Any, values: NDArray[Any]) -> Any:
    """What Rerun is sent of a column; None: it cannot be shown."""
    if values.dtype == np.uint8 and values.ndim == 4 and len(values):
        if values.shape[1] in (1, 3, 4) and values.shape[3] not in (1, 3, 4):
            values = values.transpose(0, 2, 3, 1)
        height, width, channels = values.shape[1:]
        if channels in (1, 3, 4):
            model = {1: rerun.ColorModel.L, 3: rerun.ColorModel.RGB, 4: rerun.ColorModel.RGBA}[channels]
            image = rerun.components.ImageFormat(width=width, height=height, color_model=model, channel_datatype=rerun.ChannelDatatype.U8)
            frames = np.ascontiguousarray(values).reshape(len(values), -1)
            return rerun.Image.columns(buffer=frames, format=[image] * len(values))
    if values.dtype.kind not in "biuf" or not len(values):
        return None
    curves = values.reshape(len(values), -1)
    if not 0 < curves.shape[1] <= _MOST_CURVES:
        return None
    scalars = curves.astype(np.float64)
    return rerun.Scalars.columns(scalars=scalars.ravel()).partition([curves.shape[1]] * len(curves))
