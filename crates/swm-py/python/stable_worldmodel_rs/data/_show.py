"""How a dataset shows itself: a line of text, and a table with images in notebooks."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stable_worldmodel_rs import _swm

if TYPE_CHECKING:
    from .native import NativeDataset

EPISODES = 3
FRAMES = 8
GAP = 2


def text(dataset: NativeDataset) -> str:
    """One line."""
    rows = int(dataset.lengths.sum())
    return (
        f"{type(dataset).__name__}({str(dataset.path)!r}, {len(dataset.lengths)} episodes, {rows} rows, {len(dataset)} clips of "
        f"{dataset.num_steps} × {dataset.frameskip}, columns={dataset.column_names})"
    )


def html(dataset: NativeDataset) -> str:
    """A table of the columns, what is known of the recording, and a contact sheet."""
    fields = dataset._fields  # pyright: ignore[reportPrivateUsage]
    cells = "".join(
        f"<tr><td>{escape(key)}</td><td>{fields[key][1]}</td><td>{tuple(fields[key][2])}</td><td>{fields[key][3]}</td></tr>"
        for key in dataset.column_names
        if key in fields
    )
    known = dataset.metadata or {}
    about = ", ".join(f"{key}: {escape(str(known[key]))}" for key in ("env", "policy", "seed") if known.get(key) is not None)
    parts = [f"<p><b>{escape(text(dataset).split(', columns')[0])})</b><br>{about}</p>"]
    sheet = contact_sheet(dataset)
    if sheet is not None:
        parts.append(f'<img src="{data_uri(sheet)}">')
    parts.append(f"<table><tr><th>column</th><th>type</th><th>shape</th><th>per</th></tr>{cells}</table>")
    return "".join(parts)


def contact_sheet(dataset: NativeDataset) -> NDArray[np.uint8] | None:
    """Rows of the first episodes side by side, ``(H, W, 3)``; ``None`` without images."""
    fields = dataset._fields  # pyright: ignore[reportPrivateUsage]
    images = [key for key in dataset.column_names if key in fields and fields[key][1] == "uint8" and fields[key][2][2:] == [3]]
    if not images or not len(dataset.lengths):
        return None
    key = "pixels" if "pixels" in images else images[0]
    lines: list[NDArray[Any]] = []
    for length, offset in list(zip(dataset.lengths.tolist(), dataset.offsets.tolist(), strict=True))[:EPISODES]:
        wanted: NDArray[np.int64] = np.asarray(offset + np.linspace(0, length - 1, FRAMES), dtype=np.int64)
        frames = dataset._rows(wanted, [key])[key]  # pyright: ignore[reportPrivateUsage]
        lines.append(np.concatenate([np.pad(frame, ((0, GAP), (0, GAP), (0, 0)), constant_values=255) for frame in frames], axis=1))
    return np.ascontiguousarray(np.concatenate(lines))


def data_uri(pixels: NDArray[np.uint8]) -> str:
    """An image ``(H, W, 3)`` as the source of an ``img``."""
    return "data:image/png;base64," + base64.b64encode(_swm.encode_png(np.ascontiguousarray(pixels))).decode()
