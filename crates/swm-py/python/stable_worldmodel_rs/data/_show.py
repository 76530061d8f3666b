"""How a dataset shows itself: a line of text, and a table with images in notebooks."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._core import core as _swm

if TYPE_CHECKING:
    from .native import NativeDataset

EPISODES = 3
FRAMES = 4  # As many as the core's contact sheet has in a row.


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
    frames = samples(dataset)
    if frames is not None:
        image = base64.b64encode(_swm.contact_sheet(frames)).decode()
        parts.append(f'<img src="data:image/png;base64,{image}">')
    parts.append(f"<table><tr><th>column</th><th>type</th><th>shape</th><th>per</th></tr>{cells}</table>")
    return "".join(parts)


def samples(dataset: NativeDataset) -> NDArray[np.uint8] | None:
    """Four frames of each of the first episodes, ``(T, H, W, 3)``; ``None`` without images."""
    fields = dataset._fields  # pyright: ignore[reportPrivateUsage]
    images = [key for key in dataset.column_names if key in fields and fields[key][1] == "uint8" and fields[key][2][2:] == [3]]
    if not images or not len(dataset.lengths):
        return None
    key = "pixels" if "pixels" in images else images[0]
    lengths: list[int] = dataset.lengths[:EPISODES].tolist()
    offsets: list[int] = dataset.offsets[:EPISODES].tolist()
    spans = zip(lengths, offsets, strict=True)
    rows = [offset + int(row) for length, offset in spans for row in np.linspace(0, length - 1, FRAMES).tolist()]
    return dataset._rows(np.asarray(rows, dtype=np.int64), [key])[key]  # pyright: ignore[reportPrivateUsage]
