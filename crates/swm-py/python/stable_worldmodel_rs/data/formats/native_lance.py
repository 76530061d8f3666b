"""Lance tables, in builds with the feature ``lance``. Elsewhere ``load_dataset`` reads them, and the classes say what to do instead.

Where it is built, this module is :mod:`stable_worldmodel_rs.data.formats.lance`. Elsewhere there is no module of that name, so
that :mod:`stable_worldmodel_rs.compat` finds the one of an installed reference, which works with our datasets.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..._core import core as _swm
from .._paths import datasets_folder, resolve
from ..format import Format, register_format, split_episode_data
from ..native import NativeDataset
from ..writers import NativeWriter
from .episode_table import EpisodeTable, table_of

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from typing_extensions import Self

__all__ = ["Lance", "LanceDataset", "LanceWriter"]
IS_BUILT = any(name == "lance" for name, *_ in _swm.dataset_formats())


def _require(what: str) -> None:
    if not IS_BUILT:
        raise _swm.DataError(
            f"{what}: this build does not write Lance tables. `load_dataset` reads them; use HDF5Dataset and HDF5Writer for new datasets, "
            "or build the wheel with Lance: `cargo xtask wheel --lance`"
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
        folder = None if cache_dir is None else datasets_folder(cache_dir)
        place = resolve(name, path, folder, ".lance", "LanceDataset")
        super().__init__(place, frameskip=frameskip, num_steps=num_steps, **options)

    @property
    def episode_column_names(self) -> list[str]:
        """Names of the values that an episode has once, in a table next to this one."""
        table = table_of(self.path)
        return sorted(name for name, *_ in _swm.Reader.open(table, "lance").fields if name != "ep_idx") if table.is_dir() else []

    def get_episode_data(self, episodes_idx: NDArray[Any] | list[int] | None = None) -> dict[str, list[Any]]:
        """Those values, one per asked episode (``None``: all), by name."""
        names = self.episode_column_names
        if not names:
            return {}
        table = LanceDataset(path=table_of(self.path))
        if len(table.lengths) < len(self.lengths):
            raise _swm.DataError(f"{table_of(self.path)} has values of {len(table.lengths)} of {len(self.lengths)} episodes")
        asked = range(len(self.lengths)) if episodes_idx is None else [int(index) for index in episodes_idx]
        columns = {name: table.get_col_data(name) for name in names}
        return {name: [column[index].item() if column.ndim == 1 and column.dtype != object else column[index] for index in asked]
                for name, column in columns.items()}

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
        self._table: EpisodeTable | None = None

    def __enter__(self) -> Self:
        goes_on = self._exists() and self.mode == "append"
        if self._exists() and self.mode == "overwrite" and table_of(self.path).is_dir():
            shutil.rmtree(table_of(self.path))
        super().__enter__()
        self._table = EpisodeTable(self.path, self.mode, goes_on)
        return self

    def write_episode(self, ep_data: dict[str, Any]) -> None:
        """Appends one episode: ``{column: (T, …) or a list of T values}``, and its :data:`EPISODE_DATA_KEY`."""
        columns, once = split_episode_data(ep_data)
        row = [] if self._table is None else self._table.row(once)
        super().write_episode(columns)
        if self._table is not None:
            self._table.write(row)

    def close(self) -> None:
        """Ends the dataset."""
        super().close()
        if self._table is not None:
            self._table.close()


class Lance(Format):
    """Lance tables, and folders that hold one."""

    name = "lance"
    supports_episode_data: ClassVar[bool] = True

    @classmethod
    def _table(cls, path: str | Path) -> Path | None:
        path = Path(path)
        if (path / "_versions").is_dir():
            return path
        tables = sorted(table for table in path.glob("*.lance") if table.is_dir() and not table.stem.endswith("_episodes"))
        return next(iter(tables), None)

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
