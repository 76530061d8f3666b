"""The guides docs/python.md and docs/torch.md, and the README's program: their blocks run, in their order, in one folder."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
BLOCK = re.compile(r"<!-- test: needs stable_worldmodel_rs( and torch)? -->\n```python\n(.*?)```", re.DOTALL)
HAS_TORCH = importlib.util.find_spec("torch") is not None


def program(page: str) -> str:
    """The blocks of a page that need the package, as one program; line numbers are those of the page.

    Blocks that need torch as well are left out where it is not installed.
    """
    text = (ROOT / page).read_text()
    lines: list[str] = []
    for block in BLOCK.finditer(text):
        if block[1] and not HAS_TORCH:
            continue
        lines += [""] * (text.count("\n", 0, block.start(2)) - len(lines)) + block[2].splitlines()
    return "\n".join(lines)


@pytest.mark.parametrize("page", ["README.md", "docs/python.md", "docs/torch.md"])
def test_the_blocks_of_a_page_run(page: str, tmp_path: Path, run_python: Any) -> None:
    if not (ROOT / page).is_file():
        pytest.skip("the pages are in the checkout only")
    code = program(page)
    assert "stable_worldmodel_rs" in code
    done = run_python(f"import os; os.chdir({str(tmp_path)!r})\nexec(compile({code!r}, {page!r}, 'exec'))")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "pusht.h5").is_file()
