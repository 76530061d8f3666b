"""``metrics.jsonl``: a line of JSON per record, in the form that ``swm-rs train`` writes."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

FILE = "metrics.jsonl"


class Lines:
    """Appends to the file, line by line; each is on its way to the disk when `write` returns.

    Args:
        path: The file.
        after: Lines about later steps are removed first; None: the file is appended to.
    """

    def __init__(self, path: Path, after: int | None) -> None:
        self._path = path
        if path.is_file():
            kept = [line for line in read_lines(path) if after is None or int(line["step"]) <= after]
            # A kill leaves at most one line that is not whole, which would spoil the next one.
            draft = path.with_name(f".{path.name}.{os.getpid()}")
            draft.write_text("".join(json.dumps(line) + "\n" for line in kept), encoding="utf-8")
            os.replace(draft, path)

    def write(self, step: int, part: str, values: Mapping[str, float]) -> None:
        """Append a record. JSON has neither NaN nor infinities: they are null."""
        plain = {name: value if math.isfinite(value) else None for name, value in values.items()}
        line = json.dumps({"step": step, "part": part, **plain}, allow_nan=False)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")


def read_lines(path: Path) -> list[dict[str, Any]]:
    """The lines of the file, or of that in a folder. A last line that is cut off is left out."""
    file = path / FILE if path.is_dir() else path
    if not file.is_file():
        raise FileNotFoundError(f"there is no {file}; `swm-rs train` and swm.track write one")
    found: list[dict[str, Any]] = []
    lines = file.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines, 1):
        try:
            record: Any = json.loads(line)
        except ValueError as error:
            if number == len(lines):
                break
            raise ValueError(f"{file}: line {number} is no JSON: {error}; remove it, or fetch the file again") from error
        if not isinstance(record, dict) or "step" not in record:
            raise ValueError(f"{file}: line {number} has no step; it is no file of metrics")
        found.append(cast("dict[str, Any]", record))
    return found


def of_line(line: Mapping[str, Any]) -> tuple[str, int, dict[str, float]]:
    """What a line is of, its step, and its numbers by name."""
    numbers = {key: value for key, value in line.items() if key != "step" and (value is None or isinstance(value, (int, float)))}
    # In JSON, null is what was no finite number.
    values = {key: float("nan") if value is None else float(value) for key, value in numbers.items()}
    return str(line.get("part", "train")), int(line["step"]), values
