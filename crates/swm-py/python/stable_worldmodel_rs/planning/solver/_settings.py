"""The settings of Rust solvers under the names of Python."""

from __future__ import annotations

from ..._swm import PlanError, Solver

__all__ = ["native_solver"]

_KEYWORDS = {
    "samples": "num_samples",
    "iterations": "n_steps",
    "elites": "topk",
    "sigma": "var_scale",
    "elites_kept": "n_elite_keep",
    "rounds": "n_outer_steps",
}


def native_solver(key: tuple[str, str]) -> Solver:
    """The Rust solver of this name with these settings, a JSON object.

    Raises:
        PlanError: Settings that do not go together; it names them by their keywords.
    """
    try:
        return Solver(*key)
    except PlanError as error:
        raise PlanError(_in_python(str(error))) from None


def _in_python(message: str) -> str:
    """What Rust says of a setting, with the keyword that it has here."""
    for setting, keyword in _KEYWORDS.items():
        message = message.replace(f"setting `{setting}`", f"setting `{keyword}`")
    return message
