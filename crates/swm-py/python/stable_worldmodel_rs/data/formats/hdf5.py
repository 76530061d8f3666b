"""HDF5: one file, a dataset per column, as the reference writes and reads it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from .._paths import datasets_folder, resolve
from ..dataset import Transform
from ..format import Format, register_format
from ..native import NativeDataset
from ..writers import NativeWriter

__all__ = ["HDF5", "HDF5Dataset", "HDF5Writer"]
_SUFFIXES = (".h5", ".hdf5")


class HDF5Dataset(NativeDataset):
    """Clips of an HDF5 file: ``<cache_dir>/datasets/<name>.h5``, or ``path``.

    The other arguments are those of :class:`~stable_worldmodel_rs.data.native.NativeDataset`.
    """

    native_format: ClassVar[str | None] = "hdf5"

    def __init__(
        self,
        name: str | None = None,
        frameskip: int = 1,
        num_steps: int = 1,
        transform: Transform | None = None,
        keys_to_load: Sequence[str] | None = None,
        keys_to_cache: Sequence[str] | None = None,
        keys_to_merge: Mapping[str, list[str] | str] | None = None,
        cache_dir: str | Path | None = None,
        path: str | Path | None = None,
        storage_options: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        if storage_options or "://" in str(path):
            raise ValueError(f"{path}: remote files are not read; copy the file here, or use swm.data.download(repo)")
        folder = None if cache_dir is None else datasets_folder(cache_dir)
        super().__init__(
            resolve(name, path, folder, ".h5", "HDF5Dataset"),
            frameskip=frameskip,
            num_steps=num_steps,
            transform=transform,
            keys_to_load=keys_to_load,
            keys_to_cache=keys_to_cache,
            keys_to_merge=keys_to_merge,
            **options,
        )

    @property
    def h5_path(self) -> Path:
        """The file."""
        return self.path


class HDF5Writer(NativeWriter):
    """Appends episodes to an HDF5 file; see :class:`~stable_worldmodel_rs.data.writers.NativeWriter`."""

    native_format: ClassVar[str] = "hdf5"


@register_format
class HDF5(Format):
    """HDF5 files, and folders that hold one."""

    name = "hdf5"

    @classmethod
    def detect(cls, path: str | Path) -> bool:
        """By the file extension; a folder by the files in it."""
        path = Path(path)
        return path.suffix in _SUFFIXES or path.is_dir() and bool(cls._files(path))

    @staticmethod
    def _files(folder: Path) -> list[Path]:
        return sorted(file for file in folder.iterdir() if file.suffix in _SUFFIXES)

    @classmethod
    def open_reader(cls, path: str | Path, **kwargs: Any) -> HDF5Dataset:
        """A dataset of the file, or of the only one in a folder."""
        path = Path(path)
        if path.is_dir():
            files = cls._files(path)
            if not files:
                raise FileNotFoundError(f"No .h5/.hdf5 file in {path}")
            if len(files) > 1:
                raise ValueError(f"Ambiguous: {path} holds {[file.name for file in files]}; name one of them")
            path = files[0]
        return HDF5Dataset(path=path, **kwargs)

    @classmethod
    def open_writer(cls, path: str | Path, **kwargs: Any) -> HDF5Writer:
        """A writer of the file."""
        return HDF5Writer(path, **kwargs)
