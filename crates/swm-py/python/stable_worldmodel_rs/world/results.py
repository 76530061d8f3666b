"""Results of evaluations: the reference's dict, with intervals, and a table in notebooks."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

# A notebook shows at most so many videos.
_VIDEOS = 4


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
