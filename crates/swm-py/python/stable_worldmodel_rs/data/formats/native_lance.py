"""Lance tables, in builds with the feature ``lance``. Elsewhere the classes exist and say what to do instead.

Where it is built, this module is :mod:`stable_worldmodel_rs.data.formats.lance`. Elsewhere there is no module of that name, so
that :mod:`stable_worldmodel_rs.compat` finds the one of an installed reference, which works with our datasets.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, ClassVar

from ..._core import core as _swm
from .._paths import get_cache_dir, resolve
from ..format import Format, register_format
from ..native import NativeDataset
from ..writers import NativeWriter

__all__ = ["Lance", "LanceDataset", "LanceWriter"]
IS_BUILT = any(name == "lance" for name, *_ in _swm.dataset_formats())


def _require(what: str) -> None:
    if not IS_BUILT:
        raise _swm.DataError(
            f"{what}: this build has no Lance tables; convert them with `swm convert` of the reference, use HDF5Dataset "
            "and HDF5Writer, or build the wheel with Lance: `cargo xtask wheel --lance`"
        )


class LanceDataset(NativeDataset):
    """Clips of a Lance table: ``<cache_dir>/datasets/<name>.lance``, or ``path``.

    The other arguments are those of :class:`~stable_worldmodel_rs.data.native.NativeDataset`.
    """

    native_format: ClassVar[str | None] = "lance"

    def __init__(
        self,
        name: str | None = None,
        frameskip: int = 1,
        num_steps: int = 1,
        cache_dir: str | Path | None = None,
        path: str | Path | None = None,
        **options: Any,
    ) -> None:
        _require("LanceDataset")
        folder = None if cache_dir is None else get_cache_dir(cache_dir, "datasets")
        place = resolve(name, path, folder, ".lance", "LanceDataset")
        super().__init__(place, frameskip=frameskip, num_steps=num_steps, **options)

    @property
    def image_columns(self) -> set[str]:
        """The columns that are images."""
        return {name for name, (_, dtype, shape, _) in self._fields.items() if dtype == "uint8" and len(shape) == 3}


class LanceWriter(NativeWriter):
    """Appends episodes to a Lance table."""

    native_format: ClassVar[str] = "lance"

    def __init__(self, path: str | Path, **options: Any) -> None:
        _require("LanceWriter")
        super().__init__(path, **options)


class Lance(Format):
    """Lance tables, and folders that hold one."""

    name = "lance"

    @classmethod
    def _table(cls, path: str | Path) -> Path | None:
        path = Path(path)
        if (path / "_versions").is_dir():
            return path
        return next((table for table in sorted(path.glob("*.lance")) if table.is_dir()), None) if path.is_dir() else None

    @classmethod
    def detect(cls, path: str | Path) -> bool:
        """By the versions of the table."""
        return cls._table(path) is not None

    @classmethod
    def open_reader(cls, path: str | Path, **kwargs: Any) -> LanceDataset:
        """A dataset of the table, or of the one in a folder."""
        return LanceDataset(path=cls._table(path) or path, **kwargs)

    @classmethod
    def open_writer(cls, path: str | Path, **kwargs: Any) -> LanceWriter:
        """A writer of the table."""
        return LanceWriter(path, **kwargs)


if IS_BUILT:
    register_format(Lance)
    sys.modules[__name__.replace("native_lance", "lance")] = sys.modules[__name__]
