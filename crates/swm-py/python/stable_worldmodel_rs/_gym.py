"""Registers the environments in gymnasium: now, or when gymnasium is imported.

``import stable_worldmodel_rs`` does not import gymnasium, which takes longer than this whole package.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

_ENTRY_POINT = "stable_worldmodel_rs.envs:Env"
_VECTOR_ENTRY_POINT = "stable_worldmodel_rs.vector:VectorEnv"


def gym_ids() -> dict[str, str]:
    """All ids for ``gymnasium.make`` and the environments of the core that they name.

    ``swm/…`` and ``swm_rs/…`` are the same ids; under `compat`, ``swm/…`` means what the reference calls so. ``swm/OGBMaze-v0`` is
    the maze of its default settings.
    """
    from .world.ids import aliases, env_ids
    from .world.mazes import MAZES, OGB_MAZE

    names = {f"swm_rs/{name.removeprefix('swm/')}": name for name in env_ids()}
    return names | {name: name for name in env_ids()} | aliases() | {OGB_MAZE: MAZES[0]} | _renamed()


def register_all() -> None:
    """Register every id that is free. An installed reference keeps its ``swm/…`` if it was imported first."""
    # By name: its functions have types that are partly unknown.
    registration: Any = import_module("gymnasium.envs.registration")

    renamed = _renamed()
    for name in gym_ids():
        if name not in registration.registry:
            # Processes of a vector have no `compat`.
            meant = f"swm_rs/{renamed[name].removeprefix('swm/')}" if name in renamed else name
            registration.register(
                id=name, entry_point=_ENTRY_POINT, vector_entry_point=_VECTOR_ENTRY_POINT, kwargs={"env_name": meant}
            )


def register_renamed() -> None:
    """Register the ids anew of which `compat` has just changed the meaning. Those of an installed reference stay."""
    from .compat import RENAMED

    if "gymnasium" not in sys.modules:
        return
    registration: Any = import_module("gymnasium.envs.registration")
    for name in RENAMED:
        spec = registration.registry.get(name)
        if spec is not None and spec.entry_point == _ENTRY_POINT:
            del registration.registry[name]
    register_all()


def _renamed() -> dict[str, str]:
    """Ids that mean another environment while `compat` is installed."""
    from .compat import RENAMED, is_installed

    return RENAMED if is_installed() else {}


class _WhenImported(MetaPathFinder):
    """Finds nothing itself; lets the one import of gymnasium end with `register_all`."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of gymnasium, whose loader registers once the module has run; None for all others."""
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is None or spec.loader is None:
            return None
        loader = spec.loader
        run = loader.exec_module

        def run_and_register(module: ModuleType) -> None:
            del loader.exec_module  # the class has it still
            run(module)
            register_all()

        loader.exec_module = run_and_register  # pyright: ignore[reportAttributeAccessIssue]
        return spec


def register_when_imported() -> None:
    """Register now if gymnasium is there, else as soon as it is imported."""
    if "gymnasium" in sys.modules:
        register_all()
    elif not any(isinstance(finder, _WhenImported) for finder in sys.meta_path):
        sys.meta_path.insert(0, _WhenImported())
