"""The documentation of a solver's arguments: what its class states, and for the others the table of the Rust solvers."""

from __future__ import annotations

import inspect
from dataclasses import fields
from typing import TYPE_CHECKING

from ._settings import native_settings, setting_of

if TYPE_CHECKING:
    from ._base import BaseSolver

__all__ = ["document"]

_ARGUMENTS = {
    "cost": "What to minimize: anything with ``get_cost`` (:class:`~stable_worldmodel_rs.protocols.Costable`).",
    "batch_size": "Rows that the cost is given at once; None: all. Plans do not depend on it.",
    "topk": "Candidates that a refit uses.",
    "device": "Where the cost is given its candidates.",
    "seed": "Seed of the noise, in addition to the episode's.",
    "callbacks": "Recorders of every iteration, see :mod:`stable_worldmodel_rs.planning.solver.callbacks`.",
}
"""What solvers have in common, and what differs from the table."""


def document(solver: type[BaseSolver], native_name: str) -> None:
    """Adds the arguments that the documentation of a class leaves out to its section ``Args``, in their order."""
    before, found, after = inspect.cleandoc(solver.__doc__ or "").partition("\nArgs:\n")
    if not found:  # Python runs without documentation.
        return
    own, gap, rest = after.partition("\n\n")
    entries: dict[str, str] = {}
    for line in own.splitlines():
        if line.startswith("     "):  # It continues the entry before it.
            entries[list(entries)[-1]] += f"\n{line}"
        else:
            entries[line.strip().partition(":")[0]] = line
    settings = native_settings(native_name)
    for name in (field.name for field in fields(solver)):
        if name not in entries:
            text = _ARGUMENTS.get(name) or settings[setting_of(name)].removesuffix(".") + "."
            entries[name] = f"    {name}: {text}"
    lines = "\n".join(entries[field.name] for field in fields(solver))
    solver.__doc__ = f"{before}\nArgs:\n{lines}{gap}{rest}"
