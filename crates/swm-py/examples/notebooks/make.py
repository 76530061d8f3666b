#!/usr/bin/env python3
"""Makes the notebooks of the scripts beside it: `python make.py` writes them, `python make.py --check` compares.

A script is divided by lines `# %%` (code) and `# %% [markdown]` (text in comments), as editors read it. Notebooks have no outputs.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
SCRIPTS = ("first_steps", "train_jepa", "evaluate_and_compare", "robustness")


def cells(text: str) -> list[dict[str, Any]]:
    """The cells of a script."""
    found: list[dict[str, Any]] = []
    for part in ("\n" + text).split("\n# %%")[1:]:
        head, _, body = part.partition("\n")
        is_text = "[markdown]" in head
        lines = body.strip("\n").split("\n")
        if is_text:
            lines = [line.removeprefix("#").removeprefix(" ") for line in lines if line.startswith("#")]
        source = [line + "\n" for line in lines[:-1]] + lines[-1:]
        cell: dict[str, Any] = {"cell_type": "markdown" if is_text else "code", "id": f"cell-{len(found)}", "metadata": {}, "source": source}
        found.append(cell if is_text else {**cell, "execution_count": None, "outputs": []})
    return found


def notebook(text: str) -> str:
    """The notebook of a script."""
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    whole = {"cells": cells(text), "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


def main() -> int:
    stale = []
    for name in SCRIPTS:
        text, file = notebook((HERE / f"{name}.py").read_text(encoding="utf-8")), HERE / f"{name}.ipynb"
        if "--check" not in sys.argv:
            file.write_text(text, encoding="utf-8")
        elif not file.is_file() or file.read_text(encoding="utf-8") != text:
            stale.append(file.name)
    if stale:
        print(f"{', '.join(stale)}: not those of the scripts; run {Path(__file__).name}", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    raise SystemExit(main())
