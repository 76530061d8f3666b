"""Pages of the book about the package, and the README's program: their blocks run, in their order, in one folder."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
BLOCK = re.compile(r"<!-- test: needs stable_worldmodel_rs((?: and \w+)*) -->\n```python\n(.*?)```", re.DOTALL)


def program(page: str) -> str:
    """The blocks of a page that need the package, as one program; line numbers are those of the page.

    Blocks that need other packages as well are left out where one of these is not installed.
    """
    text = (ROOT / page).read_text()
    lines: list[str] = []
    for block in BLOCK.finditer(text):
        if not all(importlib.util.find_spec(name) for name in block[1].split(" and ")[1:]):
            continue
        lines += [""] * (text.count("\n", 0, block.start(2)) - len(lines)) + block[2].splitlines()
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("page", "made"),
    [
        ("README.md", "pusht.h5"),
        ("docs/python.md", "pusht.h5"),
        ("docs/torch.md", "pusht.h5"),
        ("docs/own-data.md", "lab.h5"),
        ("docs/datasets.md", "mine.h5"),
        ("docs/handing-on.md", "rooms-bundle/SHA256SUMS"),
    ],
)
def test_the_blocks_of_a_page_run(page: str, made: str, tmp_path: Path, run_python: Any) -> None:
    if not (ROOT / page).is_file():
        pytest.skip("the pages are in the checkout only")
    code = program(page)
    assert "stable_worldmodel_rs" in code
    done = run_python(f"import os; os.chdir({str(tmp_path)!r})\nexec(compile({code!r}, {page!r}, 'exec'))")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / made).is_file()
