"""The settings of the Rust solvers under the keywords of Python, which are the reference's."""

from __future__ import annotations

import functools
from typing import Any

from ..._swm import PlanError, Solver, solvers

__all__ = ["KEYWORDS", "as_setting", "native_settings", "native_solver", "setting_of"]

KEYWORDS: dict[str, str] = {
    "num_samples": "samples",
    "n_steps": "iterations",
    "topk": "elites",
    "var_scale": "sigma",
    "noise_scale": "sigma",
    "n_elite_keep": "elites_kept",
    "n_outer_steps": "rounds",
}
"""The setting behind each keyword that has another name."""


def setting_of(keyword: str) -> str:
    """The name of the setting behind a keyword."""
    return KEYWORDS.get(keyword, keyword)


def native_settings(name: str) -> dict[str, str]:
    """The settings of a Rust solver in the order of its table, with their documentation."""
    return _tables().get(name, {})


@functools.cache
def _tables() -> dict[str, dict[str, str]]:
    """Those of all Rust solvers."""
    return {solver: {setting: doc for setting, doc, _ in settings} for solver, _, settings in solvers()}


def native_solver(key: tuple[str, str], keywords: dict[str, str]) -> Solver:
    """The Rust solver of this name with these settings, a JSON object.

    Args:
        key: Its name and its settings.
        keywords: The keyword of each setting.

    Raises:
        PlanError: Settings that do not go together; it names them by their keywords.
    """
    try:
        return Solver(*key)
    except PlanError as error:
        message = str(error)
        for setting, keyword in keywords.items():
            message = message.replace(f"setting `{setting}`", f"setting `{keyword}`")
        raise PlanError(message) from None


def as_setting(value: Any, default: Any) -> Any:
    """The value of an argument as JSON has it: whole numbers of one whose default is a float are floats, too."""
    return float(value) if isinstance(default, float) else value
