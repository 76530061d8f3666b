"""Metrics of trainings and evaluations: one file, ``metrics.jsonl``, and thin sinks to trackers over it.

A tracker's library is imported when it is asked for; nothing is sent from this machine unless that library is told to.
"""

from __future__ import annotations

import itertools
import json
import logging
import os
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

from .._arguments import target_path, whole_number
from ._lines import FILE, Lines, of_line, read_lines
from ._sinks import PROJECT, SINKS, Run, Sink, open_sink, open_sinks
from ._values import Values, flat, numbers

__all__ = ["TRACKERS", "Tracker", "read", "send", "start"]

# The trackers that there are.
TRACKERS: tuple[str, ...] = tuple(SINKS)
logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")


class Tracker:
    """Takes values by step, and hands them to a file and to trackers. A context manager, which ends the run.

    Args:
        to: Names of trackers, ``"trackio"``, ``"wandb"``, ``"mlflow"`` or ``"tensorboard"``; none: the file alone.
        folder: Where ``metrics.jsonl`` is, and what the trackers write; None: no file, and trackers in the current folder.
        project: What trackers group runs by.
        name: The run's name; None: that of the folder.
        config: Settings of the run.
        after: The step that a training goes on from: later lines of the file are removed, as they come again.

    Example:
        >>> with swm.track.start(None, "run") as tracker:
        ...     tracker.log({"loss": 0.5}, step=1)
    """

    def __init__(
        self,
        to: str | Sequence[str] | None,
        folder: str | os.PathLike[str] | None,
        *,
        project: str = PROJECT,
        name: str | None = None,
        config: Mapping[str, Any] | None = None,
        after: int | None = None,
    ) -> None:
        names = [] if to is None else [to] if isinstance(to, str) else list(to)
        after = None if after is None else whole_number("after", after)
        self.folder: Path | None = None if folder is None else target_path("folder", folder)
        where = self.folder or Path()
        where.mkdir(parents=True, exist_ok=True)
        run = Run(where, project, name or where.resolve().name, flat(config or {}), after)
        # All of them before the file: of a library that is missing, nothing is left.
        self._sinks: list[Sink] = []
        try:
            for one in names:
                self._sinks.append(open_sink(one, run))
        except BaseException:
            self.finish()
            raise
        self._lines: Lines | None = None if self.folder is None else Lines(self.folder / FILE, after)
        self._step = 0 if after is None else after

    def log(self, values: Mapping[str, Any], step: int | None = None, part: str = "train") -> None:
        """Take numbers by name.

        Args:
            values: Numbers, arrays and tensors of one number; NaN and infinities are kept as far as a tracker can.
            step: Of the training; None: that of the last call and one more.
            part: What they are of; it is before their names in trackers: ``train/loss``.

        Raises:
            TypeError: A value is no number, or ``step`` no whole one; the message names it.
            ValueError: ``step`` is negative.
        """
        self._step = self._step + 1 if step is None else whole_number("step", step)
        found = numbers(values)
        if self._lines is not None:
            self._lines.write(self._step, part, found)
        named = {f"{part}/{name}": value for name, value in found.items()}
        for sink in self._sinks:
            sink.log(self._step, named)

    def evaluation(self, result: Mapping[str, Any], *, name: str = "evaluation", step: int | None = None) -> None:
        """Take an evaluation: its success rate with the 95 % interval, the receipt, videos.

        Args:
            result: What `swm.evaluate`, `World.evaluate` or `swm.sweep` returned.
            name: What it is called.
            step: Of the training that it is of; None: that of the last call.
        """
        at = self._step if step is None else whole_number("step", step)
        self.log(_figures(result), at, name)
        text, videos = _document(result), [Path(path) for path in result.get("videos") or ()]
        if self._sinks or self.folder is not None:
            file = _write(self.folder, self._free(f"{name.replace('/', '-')}-{at}"), text)
            for sink in self._sinks:
                sink.document(name, file, at)
        for video in videos:
            for sink in self._sinks:
                sink.video(f"{name}/{video.stem}", video, at)

    def _free(self, stem: str) -> str:
        """The name of a file that is not there yet: a step may have several evaluations."""
        places = (self.folder or Path()) / "evaluations"
        names = (f"{stem}.json" if number == 1 else f"{stem}-{number}.json" for number in itertools.count(1))
        return next(name for name in names if not (places / name).exists())

    def finish(self) -> None:
        """End the run. More than once is no error."""
        sinks, self._sinks = self._sinks, []
        for sink in sinks:
            sink.finish()

    def __enter__(self) -> Tracker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.finish()


def start(
    to: str | Sequence[str] | None,
    folder: str | os.PathLike[str] | None,
    *,
    project: str = PROJECT,
    name: str | None = None,
    config: Mapping[str, Any] | None = None,
    after: int | None = None,
) -> Tracker:
    """Begin a run, or go on with the one in the folder; the arguments are those of `Tracker`.

    Raises:
        ImportError: The tracker's library is not installed; the message has how to install it.
        ValueError: There is no tracker of that name.
    """
    return Tracker(to, folder, project=project, name=name, config=config, after=after)


def read(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """The lines of ``metrics.jsonl``, or of that in a folder: also of a run of ``swm-rs train``. A last line that was cut off is left out.

    Raises:
        FileNotFoundError: There is no such file.
    """
    return read_lines(Path(path).expanduser())


def send(
    run: str | os.PathLike[str],
    to: str | Sequence[str],
    *,
    project: str = PROJECT,
    name: str | None = None,
) -> int:
    """Hand the metrics of a run that is over, or at work, to trackers: one of `start` or of ``swm-rs train``. Gives how many lines.

    Args:
        run: Its folder.
        to: Names of trackers.
        project: What trackers group runs by.
        name: The run's name; None: that of the folder.
    """
    folder = Path(run).expanduser()
    lines = read_lines(folder)
    sinks = open_sinks([to] if isinstance(to, str) else to, folder, project, name, None)
    try:
        for line in lines:
            part, step, values = of_line(line)
            for sink in sinks:
                sink.log(step, {f"{part}/{key}": value for key, value in values.items()})
    finally:
        for sink in sinks:
            sink.finish()
    return len(lines)


@contextmanager
def tracked(tracker: Tracker | str | Sequence[str] | None, folder: str | os.PathLike[str] | None) -> Generator[Tracker | None]:
    """What ``tracker=`` was given; a name is opened, and its run ended afterwards."""
    if tracker is None or isinstance(tracker, Tracker):
        yield tracker
        return
    with Tracker(tracker, folder) as opened:
        yield opened


def _figures(result: Mapping[str, Any]) -> Values:
    """The numbers of an evaluation."""
    values: Values = {}
    if "cells" in result:
        for cell in result["cells"]:
            if cell["summary"] is not None:
                called = f"{cell['name']} {cell['value']}".strip()
                values.update({f"{called}/{key}": value for key, value in _rate(cell["summary"]).items()})
        return values
    if "summary" in result:
        values = _rate(result["summary"])
    elif result.get("has_success", True):
        values = _rate({**result, "ci95": result["interval"]})
    for other in result.get("references") or ():
        values[f"{other['role']}/success_rate"] = float(other["summary"]["success_rate"])
    returns = result.get("episode_returns")
    if returns is not None and len(returns):
        values["return"] = float(sum(map(float, returns)) / len(returns))
    return values


def _rate(summary: Mapping[str, Any]) -> Values:
    low, high = summary["ci95"]
    return {
        "success_rate": float(summary["success_rate"]),
        "success_low": float(low),
        "success_high": float(high),
        "episodes": float(summary["episodes"]),
    }


def _document(result: Mapping[str, Any]) -> str:
    """The result as JSON."""
    own: Any = getattr(result, "to_json", None)
    return json.dumps(result) if own is None else str(own())


def _write(folder: Path | None, name: str, text: str) -> Path:
    where = (folder or Path()) / "evaluations"
    where.mkdir(parents=True, exist_ok=True)
    path = where / name
    draft = path.with_name(f".{name}.{os.getpid()}")
    draft.write_text(text + "\n", encoding="utf-8")
    os.replace(draft, path)
    return path
