"""Results of evaluations, comparisons and sweeps: dicts with a table for people, in notebooks, too."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from .._arguments import target_path

# A notebook shows at most so many videos.
_VIDEOS = 4
# A verification names at most so many episodes.
_SHOWN = 12


class EvaluationResult(dict[str, Any]):
    """What an evaluation came to: a dict with the reference's keys and some more.

    ``success_rate`` (percent), ``episode_successes`` bool ``(E,)``, ``seeds`` i64 ``(E,)``; ``interval`` (95 % Wilson
    interval of the success rate, percent), ``episodes``, ``episode_lengths`` i64 ``(E,)``, ``episode_returns`` f64
    ``(E,)``, ``first_success_steps`` (None: never), ``solved_at_start``, ``mean_success_steps``, ``has_success``,
    ``setup`` (how to repeat it), ``videos`` (paths), ``wall_time_s``.
    """

    @classmethod
    def from_json(cls, text: str, videos: Sequence[str] = ()) -> EvaluationResult:
        """Read the JSON that the core writes."""
        data: dict[str, Any] = json.loads(text)
        return cls(
            success_rate=float(data["success_rate"]),
            episode_successes=np.array(data["episode_successes"], dtype=bool),
            seeds=np.array(data["seeds"], dtype=np.int64),
            interval=(float(data["ci95"][0]), float(data["ci95"][1])),
            episodes=int(data["episodes"]),
            episode_lengths=np.array(data["episode_lengths"], dtype=np.int64),
            episode_returns=np.array(
                [np.nan if value is None else value for value in data["episode_returns"]], dtype=np.float64
            ),
            first_success_steps=list(data["first_success_steps"]),
            solved_at_start=int(data["solved_at_start"]),
            mean_success_steps=data["mean_success_steps"],
            has_success=bool(data["has_success"]),
            setup=data["setup"],
            videos=list(videos),
            wall_time_s=float(data["wall_time_s"]),
        )

    def plain(self) -> dict[str, Any]:
        """The same with lists and numbers of Python in place of arrays, and None for NaN: what ``json.dumps`` takes."""
        return {name: _plain(value) for name, value in self.items()}

    def to_json(self, path: str | PathLike[str] | None = None, *, indent: int | None = None) -> str:
        """The result as JSON, which is also written to ``path``.

        Arrays are the reference's contract: ``json.dumps`` does not take them, so that it needs :meth:`plain`.
        """
        text = json.dumps(self.plain(), indent=indent, allow_nan=False)
        if path is not None:
            target_path("path", path).write_text(text + "\n", encoding="utf-8")
        return text

    def rows(self) -> list[tuple[str, str]]:
        """The table that people read."""
        successes = int(np.sum(self["episode_successes"]))
        rows = [("episodes", str(len(self["episode_successes"])))]
        if self.get("has_success", True):
            rows.append(("success", f"{self['success_rate']:.1f} % ({successes})"))
            if "interval" in self:
                low, high = self["interval"]
                rows.append(("95 % interval", f"{low:.1f} to {high:.1f} %"))
        if (steps := self.get("mean_success_steps")) is not None:
            rows.append(("mean steps to success", f"{steps:.1f}"))
        if "episode_returns" in self and len(self["episode_returns"]):
            rows.append(("return per episode", f"{float(np.mean(np.asarray(self['episode_returns'], np.float64))):.2f}"))
        setup: Mapping[str, Any] = self.get("setup") or {}
        rows += [(name, str(setup[key])) for name, key in (("policy", "policy"), ("environment", "env")) if key in setup]
        return rows

    def __repr__(self) -> str:
        return "EvaluationResult(" + ", ".join(f"{name}: {value}" for name, value in self.rows()) + ")"

    def _repr_html_(self) -> str:
        return html_table(self.rows()) + "".join(_video(path) for path in self.get("videos", ())[:_VIDEOS])


class Receipt(dict[str, Any]):
    """What a policy came to on a manifest, and all it takes to repeat it: the JSON of ``receipt.json``."""

    @property
    def success_rate(self) -> float:
        """In percent."""
        return float(self["summary"]["success_rate"])

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the success rate, in percent."""
        low, high = self["summary"]["ci95"]
        return float(low), float(high)

    @property
    def episode_successes(self) -> npt.NDArray[np.bool_]:
        """Of every pair, bool ``(E,)``."""
        return np.array([episode["success"] for episode in self["episodes"]], dtype=bool)

    def differences(self, other: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
        """In what this result and another one differ, by name: here, there. Nothing where they are equal to the last bit.

        Policies, their settings, seeds and weights (by content), the manifest, the environment's tables, physics and images, what
        came out in every episode, and the reference policies. Wall times and versions of the package may differ.
        """
        from .._core import core as _swm

        found = json.loads(_swm.receipt_differences(json.dumps(self), json.dumps(other)))
        return {one["what"]: (one["first"], one["this"]) for one in found}

    def rows(self) -> list[tuple[str, str]]:
        """The table that people read."""
        rows = [(str(self["policy"]), rate(self["summary"]))]
        for other in self["references"]:
            low, high = other["test"]["interval95"]
            difference = f"difference {other['test']['difference']:+.1f} ({low:+.1f} to {high:+.1f})"
            rows.append((str(other["role"]), f"{rate(other['summary'])}, {difference}"))
        at_reset = self["summary"]["solved_at_start"]
        rows.append(("pairs", f"{len(self['episodes'])}, {at_reset} with success at reset, which count for every policy"))
        return rows

    def __repr__(self) -> str:
        return f"Receipt({self['manifest']['env']}, " + ", ".join(f"{name}: {rate}" for name, rate in self.rows()) + ")"

    def _repr_html_(self) -> str:
        return html_table(self.rows())


class Verification(dict[str, Any]):
    """What a repetition of a result showed.

    ``equal``: whether all that was compared is equal to the last bit; ``differences`` by part (``model``, ``solver``, ``physics``, …); the
    ``episodes`` that differ; ``checked`` and ``not_checked``: what was compared, and what was not and why; ``summary`` of the repetition, and
    ``recorded``, that of the receipt.
    """

    def rows(self) -> list[tuple[str, str]]:
        """The table that people read."""
        rows = [("equal", "yes, in all that was checked" if self["equal"] else "no")]
        rows += [(f"differs: {part}", str(what)) for part, what in self["differences"].items()]
        if self["episodes"]:
            rows.append(("episodes that differ", ", ".join(map(str, self["episodes"][:_SHOWN])) + (", …" if len(self["episodes"]) > _SHOWN else "")))
        rows += [("success", f"{rate(self['summary'])}, recorded {rate(self['recorded'])}")]
        rows += [("checked", ", ".join(self["checked"]))]
        rows += [("not checked", what) for what in self["not_checked"]]
        return rows

    def __repr__(self) -> str:
        return "Verification(" + ", ".join(f"{name}: {text}" for name, text in self.rows()) + ")"

    def __str__(self) -> str:
        return "\n".join(f"{name}: {text}" for name, text in self.rows())

    def _repr_html_(self) -> str:
        return html_table(self.rows())


class Comparison(list[dict[str, Any]]):
    """Sides of a comparison: ``name``, ``policy``, ``runs``, ``success_rate``, ``ci95``, ``std`` (between seeds), and ``test``:
    the first side against this one, pair by pair (``difference``, ``interval95``, ``p_value``); and ``differs``: in what the evaluation
    differs from the first one, a list of ``what``, ``first`` and ``this``."""

    def __repr__(self) -> str:
        return "Comparison(" + ", ".join(f"{name}: {text}" for name, text in self.rows()) + ")"

    def rows(self) -> list[tuple[str, str]]:
        """The table that people read."""
        rows: list[tuple[str, str]] = []
        for side in self:
            text = rate(side)
            if side["test"] is not None:
                low, high = side["test"]["interval95"]
                difference = side["test"]["difference"]
                text += f", first − this {difference:+.1f} ({low:+.1f} to {high:+.1f}), p = {side['test']['p_value']:.4f}"
            rows.append((str(side["name"]), text))
            rows += [
                (f"{side['name']}: {one['what']}", f"{_short(one['this'])} (first: {_short(one['first'])})") for one in side["differs"]
            ]
        return rows

    def _repr_html_(self) -> str:
        return html_table(self.rows())


class Sweep(dict[str, Any]):
    """A policy under changed factors: the JSON of ``sweep.json``. ``cells`` has a dict per evaluation: ``name`` and ``value`` of what is
    changed, ``summary``, ``test`` against the unchanged environment (the first cell), ``note``, ``successes``."""

    def rows(self) -> list[tuple[str, str]]:
        """The table that people read."""
        rows: list[tuple[str, str]] = []
        for cell in self["cells"]:
            text = "–" if cell["summary"] is None else rate(cell["summary"])
            if cell["test"] is not None:
                low, high = cell["test"]["interval95"]
                text += f", difference {cell['test']['difference']:+.1f} ({low:+.1f} to {high:+.1f})"
            note = cell.get("note")
            rows.append((f"{cell['name']} {cell['value']}".strip(), text if note is None else f"{text}; {note}"))
        return rows

    def __repr__(self) -> str:
        return f"Sweep({self['env']}, {self['policy']}, " + ", ".join(f"{name}: {text}" for name, text in self.rows()) + ")"

    def _repr_html_(self) -> str:
        return html_table(self.rows())


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(cast("Any", value).tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in cast("Mapping[str, Any]", value).items()}
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in cast("list[Any]", value)]
    return str(cast("Any", value)) if isinstance(value, PathLike) else value


def rate(summary: Mapping[str, Any]) -> str:
    """A success rate with its interval."""
    low, high = summary["ci95"]
    return f"{summary['success_rate']:.1f} % ({low:.1f} to {high:.1f})"


def _short(value: Any) -> str:
    """A value in few words: hashes by their beginning."""
    if value is None:
        return "–"
    if isinstance(value, list):
        return " + ".join(_short(one) for one in cast("list[Any]", value)) or "none"
    text = str(value)
    return text[:12] if len(text) == 64 else text


def html_table(rows: Sequence[tuple[str, str]]) -> str:
    """Rows of a name and a value as an HTML table."""
    cells = (f"<tr><th style='text-align:left'>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
    return f"<table>{''.join(cells)}</table>"


def html_image(png: bytes, title: str = "") -> str:
    """A PNG within a page."""
    data = base64.b64encode(png).decode()
    return f"<img title='{escape(title)}' src='data:image/png;base64,{data}'/>"


def _video(path: str) -> str:
    file = Path(path)
    if not file.exists():
        return ""
    data = base64.b64encode(file.read_bytes()).decode()
    if file.suffix == ".gif":
        return f"<img src='data:image/gif;base64,{data}'/>"
    return f"<video controls loop muted src='data:video/mp4;base64,{data}'></video>"
