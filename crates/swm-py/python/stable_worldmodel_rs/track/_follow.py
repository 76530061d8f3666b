"""A training's ``metrics.jsonl``, followed while it grows, and handed to trackers line by line."""

from __future__ import annotations

import json
import logging
import os
import re
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from . import Tracker
from ._lines import FILE, of_line
from ._sinks import PROJECT, Sink, library, open_sinks

# A training writes event files for TensorBoard by itself.
OWN = "tensorboard"
logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")


class Follower:
    """Hands the lines of a run's metrics on as they come.

    A training that goes on writes the file anew, up to its last checkpoint, and only lines after that are new. Until then, what is there is
    that of an earlier program.

    Args:
        folder: The run's folder; it need not be there yet.
        to: A `Tracker`, or names of trackers, whose libraries are imported now.
        project: What trackers group runs by.
        name: The run's name; None: that of the folder.

    Raises:
        ImportError: A library is not installed.
        ValueError: There is no tracker of a name; or the tracker's own file is the run's.
    """

    def __init__(
        self, folder: Path, to: Tracker | Sequence[str], *, project: str = PROJECT, name: str | None = None
    ) -> None:
        self._folder, self._file = folder, folder / FILE
        self._before = _identity(self._file)
        self._after = _last_checkpoint(folder)
        self._at, self._rest = 0, b""
        self._sinks: list[Sink] | None = None
        self._log: Callable[[str, int, Mapping[str, float]], None] = self._to_sinks
        self._names: list[str] = []
        self._project, self._name = project, name
        if isinstance(to, Tracker):
            if to.folder is not None and to.folder.resolve() == folder.resolve():
                raise ValueError(f"tracker=: its folder is that of the run, {folder}, whose metrics.jsonl the training writes; give it another one, or None")
            tracker = to
            self._log = lambda part, step, values: tracker.log(values, step, part)
        else:
            self._names = [one for one in to if one != OWN]
            for one in self._names:
                library(one)

    def poll(self) -> None:
        """Hand on what was written since the last call."""
        found = _identity(self._file)
        if found is None or found == self._before:
            return
        with self._file.open("rb") as file:
            file.seek(self._at)
            data = self._rest + file.read()
            self._at = file.tell()
        *whole, self._rest = data.split(b"\n")
        for text in whole:
            line: dict[str, Any] = json.loads(text)
            part, step, values = of_line(line)
            if self._after is None or step > self._after:
                self._log(part, step, values)

    def finish(self) -> None:
        """Hand on the rest, and end the runs of trackers that were named."""
        try:
            self.poll()
        finally:
            sinks, self._sinks = self._sinks or [], []
            for sink in sinks:
                sink.finish()

    def _to_sinks(self, part: str, step: int, values: Mapping[str, float]) -> None:
        if self._sinks is None:
            # The training has written its settings by now.
            self._sinks = open_sinks(self._names, self._folder, self._project, self._name, self._after)
        named = {f"{part}/{name}": value for name, value in values.items()}
        for sink in self._sinks:
            sink.log(step, named)


@contextmanager
def following(tracker: Tracker | str | Sequence[str] | None, run: str | os.PathLike[str]) -> Generator[Follower | None]:
    """What ``tracker=`` of a training was given, as a follower of its run."""
    if tracker is None:
        yield None
        return
    names = [tracker] if isinstance(tracker, str) else tracker
    follower = Follower(Path(run), names)
    try:
        yield follower
    finally:
        follower.finish()


def _identity(file: Path) -> int | None:
    """Tells a file from the one that replaces it."""
    try:
        return file.stat().st_ino
    except FileNotFoundError:
        return None


def _last_checkpoint(folder: Path) -> int | None:
    """The step of a run's last checkpoint; None: it begins."""
    names = (re.fullmatch(r"step-(\d+)\.json", path.name) for path in (folder / "checkpoints").glob("step-*.json"))
    steps = [int(name[1]) for name in names if name is not None]
    return max(steps, default=0) if (folder / "config.json").is_file() else None
