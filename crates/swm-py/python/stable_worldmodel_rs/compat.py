"""Serves this package under the reference's name, ``stable_worldmodel``.

For configurations that name classes by path (Hydra's ``_target_: stable_worldmodel.policy.WorldModelPolicy``), and for
programs and tests written for the reference:

    import stable_worldmodel_rs.compat as compat
    compat.install()
    import stable_worldmodel as swm      # this package

or ``pytest -p stable_worldmodel_rs.compat``. From then on, ids of environments have the reference's meaning in this process:
``swm/TwoRoom-v1`` is this package's ``swm/TwoRoom-v2``. Ids ``swm_rs/…``, and those in files, stay this package's own.

Modules that this package lacks (``wrapper``, ``plot``) come from
an installed reference, whose code then uses this package's other modules.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from ._gym import register_renamed

__all__ = ["install", "is_installed", "uninstall"]

_THEIRS = "stable_worldmodel"
_OURS = "stable_worldmodel_rs"
# Ids under which the reference has what this package numbers otherwise.
RENAMED = {"swm/TwoRoom-v1": "swm/TwoRoom-v2"}


class _Alias(Loader):
    """Loads a module of ours under another name: it is the same object."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._spec: ModuleSpec | None = None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(self._name)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        # Importing gave it the other name's spec; relative imports and reloads go by its own.
        module.__spec__ = self._spec


class _Facade(ModuleType):
    """The package ``stable_worldmodel``: names of ours, then submodules of either."""

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):
            raise AttributeError(name)
        try:
            return getattr(import_module(_OURS), name)
        except AttributeError:
            pass
        try:
            return import_module(f"{_THEIRS}.{name}")
        except ModuleNotFoundError as error:
            if error.name != f"{_THEIRS}.{name}":
                raise
            raise AttributeError(
                f"neither {_OURS} nor an installed {_THEIRS} has `{name}`; docs/migration.md says what takes its place"
            ) from None

    def __dir__(self) -> list[str]:
        return dir(import_module(_OURS))


class _FacadeLoader(Loader):
    """Makes the package."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Facade(spec.name, import_module(_OURS).__doc__)

    def exec_module(self, module: ModuleType) -> None:
        ours = import_module(_OURS)
        module.__version__ = ours.__version__  # pyright: ignore[reportAttributeAccessIssue]
        module.__all__ = ours.__all__  # pyright: ignore[reportAttributeAccessIssue]


class _Finder(MetaPathFinder):
    """Finds ``stable_worldmodel`` and everything in it."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of our module of that name; else that of an installed reference."""
        if fullname == _THEIRS:
            spec = ModuleSpec(fullname, _FacadeLoader(), is_package=True)
            theirs = PathFinder.find_spec(_THEIRS)
            spec.submodule_search_locations = list((theirs and theirs.submodule_search_locations) or [])
            return spec
        if not fullname.startswith(f"{_THEIRS}."):
            return None
        name = _OURS + fullname[len(_THEIRS) :]
        try:
            found = find_spec(name)
        except ModuleNotFoundError:
            found = None
        if found is None:
            # Not in `path`, which is that of our package: in the reference's folder of the same name.
            roots = getattr(sys.modules.get(_THEIRS), "__path__", ())
            folders = fullname.split(".")[1:-1]
            return PathFinder.find_spec(fullname, [str(Path(root, *folders)) for root in roots])
        return ModuleSpec(fullname, _Alias(name), is_package=found.submodule_search_locations is not None)


_FINDER = _Finder()


def is_installed() -> bool:
    """Whether ``import stable_worldmodel`` gives this package."""
    return _FINDER in sys.meta_path


def install() -> None:
    """Let ``import stable_worldmodel`` give this package, in this process, and ids of environments mean the reference's.

    Raises:
        ImportError: the reference has been imported already.
    """
    if is_installed():
        return
    if _THEIRS in sys.modules:
        raise ImportError(f"{_THEIRS} has been imported already; call stable_worldmodel_rs.compat.install() before")
    sys.meta_path.insert(0, _FINDER)
    register_renamed()
    # The reference imports it, so that h5py reads compressed images from then on; its users count on that.
    if find_spec("hdf5plugin") is not None:
        import_module("hdf5plugin")


def uninstall() -> None:
    """Let ``import stable_worldmodel`` give the reference again, to those who import it from now on, and ids mean this package's."""
    if is_installed():
        sys.meta_path.remove(_FINDER)
        register_renamed()
    for name in [name for name in sys.modules if name == _THEIRS or name.startswith(f"{_THEIRS}.")]:
        del sys.modules[name]


def pytest_load_initial_conftests() -> None:
    """Called by ``pytest -p stable_worldmodel_rs.compat`` before it loads the first test."""
    install()
