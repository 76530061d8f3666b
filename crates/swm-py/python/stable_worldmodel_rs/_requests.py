"""Requests that are all in their settings: the core checks and runs them; here are their progress bars and notes."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ._arguments import request_text
from ._core import core as _swm
from ._progress import Progress

__all__ = ["asked", "log_notes"]

_logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")

# What their bars are called.
_TITLES = {
    "bench": "Measuring",
    "board": "Verifying",
    "convert": "Converting",
    "diff": "Comparing",
    "measure": "Measuring",
    "merge": "Merging",
    "plan": "Planning",
    "preview": "Drawing",
    "replay": "Replaying",
    "reproduce": "Evaluating",
    "split": "Dividing",
    "train": "Training",
    "verify": "Verifying",
}

# The arguments of settings that have another name in the core.
_ARGUMENTS = {
    "bench": {"env_option": "settings"},
    "measure": {"env_option": "settings"},
    "plan": {"env_option": "settings", "set": "variation_values", "vary": "variation"},
    "render": {"env_option": "settings", "set": "variation_values", "vary": "variation"},
    "replay": {"env_option": "settings", "set": "variation_values"},
    "reproduce": {"figure": "figures"},
    "train": {"set": "settings", "env_option": "env_options"},
}


def asked(
    name: str, request: Mapping[str, Any], progress: bool = False, watch: Callable[[], None] | None = None
) -> Any:
    """What the core makes of a request of this name; settings that are None have their defaults.

    Args:
        name: Of the request.
        request: Its settings.
        progress: Whether to show a bar.
        watch: Is called now and then meanwhile.

    Raises:
        SwmError: A setting is wrong, or the work failed.
    """
    given = {setting: value for setting, value in request.items() if value is not None}
    text = request_text(given, _ARGUMENTS.get(name))
    with Progress(_TITLES.get(name, name), enabled=progress, parts=True) as bar:

        def tick(done: int, successes: int, steps: int) -> None:
            bar.tick(done, successes, steps)
            if watch is not None:
                watch()

        made, notes = _swm.run_request(name, text, bar.begin, tick)
    log_notes(notes)
    return json.loads(made)


def log_notes(notes: Sequence[str]) -> None:
    """Logs what the core noted."""
    for note in notes:
        _logger.warning("%s", note)
