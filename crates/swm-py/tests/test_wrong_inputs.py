"""What users get wrong in their first week: each input is refused, or noted, by a message with these words. Nothing is silent."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import wrong_files
import wrong_python

try:
    import wrong_torch
except ImportError:  # No torch here.
    wrong_torch = None


Row = tuple[Callable[[Path], Any], list[str]]
TORCH: list[Row] = [] if wrong_torch is None else wrong_torch.INPUTS


def message_of(wrong: Callable[[Path], Any], folder: Path, caplog: pytest.LogCaptureFixture) -> str:
    """What a user is given: the error, or else the notes at the level that Python shows."""
    with caplog.at_level(logging.WARNING, logger="stable_worldmodel_rs"):
        try:
            noted = wrong(folder)
        except Exception as error:
            return "\n".join([f"{type(error).__name__}: {error}", *getattr(error, "__notes__", [])])
    notes = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    return "\n".join([*notes, noted or ""])


def check(wrong: Callable[[Path], Any], words: list[str], folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    message = message_of(wrong, folder, caplog)
    assert words and not [word for word in words if word not in message], message


@pytest.mark.parametrize(("wrong", "words"), [*TORCH, *wrong_python.INPUTS], ids=lambda value: getattr(value, "__name__", ""))
def test_python_refuses_or_notes(
    wrong: Callable[[Path], Any], words: list[str], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    check(wrong, words, tmp_path, caplog)


@pytest.mark.parametrize(("wrong", "words"), wrong_files.INPUTS, ids=lambda value: getattr(value, "__name__", ""))
def test_the_command_refuses_or_notes(
    wrong: Callable[[Path], Any], words: list[str], tmp_path: Path, caplog: pytest.LogCaptureFixture, command: str
) -> None:
    check(wrong, words, tmp_path, caplog)
