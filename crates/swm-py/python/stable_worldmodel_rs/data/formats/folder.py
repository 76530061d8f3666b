"""Folders: a ``.npz`` file per column, and a JPEG file per image."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .._paths import resolve
from .._tensors import to_numpy
from ..dataset import Transform
from ..format import Format, register_format
from ..native import NativeDataset
from ..writers import NativeWriter

__all__ = ["Folder", "FolderDataset", "FolderWriter", "ImageDataset"]
LENGTHS = "ep_len.npz"


def has_videos(path: Path) -> bool:
    """Whether a folder of a dataset has columns that are videos."""
    return any(any(sub.glob("*.mp4")) for sub in path.iterdir() if sub.is_dir())


class FolderDataset(NativeDataset):
    """Clips of a folder: ``<cache_dir>/<name>``, or ``path``.

    Args:
        folder_keys: The columns that are images; ``None``: all subfolders.

    The other arguments are those of :class:`~stable_worldmodel_rs.data.native.NativeDataset`.
    """

    def __init__(
        self,
        name: str | None = None,
        frameskip: int = 1,
        num_steps: int = 1,
        transform: Transform | None = None,
        keys_to_load: Sequence[str] | None = None,
        folder_keys: Sequence[str] | None = None,
        cache_dir: str | Path | None = None,
        path: str | Path | None = None,
        **options: Any,
    ) -> None:
        folder = resolve(name, path, cache_dir, "", type(self).__name__)
        if not folder.is_dir():
            raise FileNotFoundError(f"{folder} does not exist; pass path=, or cache_dir= for another folder of datasets")
        subfolders = sorted(entry.name for entry in folder.iterdir() if entry.is_dir())
        self.folder_keys: list[str] = subfolders if folder_keys is None else list(folder_keys)
        super().__init__(
            folder, frameskip=frameskip, num_steps=num_steps, transform=transform, keys_to_load=keys_to_load, **options
        )
        if keys_to_load is None:
            self._keys = [key for key in self._keys if key in self.folder_keys or key not in subfolders]

    def _load_file(self, ep_idx: int, step: int, key: str) -> NDArray[Any]:
        """One image, ``(H, W, C)``."""
        return self._rows(np.asarray([int(self.offsets[ep_idx]) + step]), [key])[key][0]

    def get_col_data(self, col: str) -> NDArray[Any]:
        """A whole column; images are too many for that."""
        if col in self.folder_keys:
            raise KeyError(f"{col!r} not in cache: images of folders are read by clip, not as a whole column")
        return super().get_col_data(col)

    def get_row_data(self, row_idx: int | list[int]) -> dict[str, Any]:
        """Rows by their number, without images."""
        keys = [key for key in self._keys if key not in self.folder_keys]
        return self._rows(to_numpy(row_idx).astype(np.int64), keys)


class ImageDataset(FolderDataset):
    """A :class:`FolderDataset` whose images are named first, by default ``["pixels"]``."""

    def __init__(self, name: str | None = None, image_keys: Sequence[str] | None = None, **options: Any) -> None:
        super().__init__(name=name, folder_keys=image_keys or ["pixels"], **options)


class FolderWriter(NativeWriter):
    """Appends episodes to a folder; uint8 columns ``(T, H, W, 1 or 3)`` become JPEG files."""

    native_format: ClassVar[str] = "folder"
    _marker = LENGTHS


@register_format
class Folder(Format):
    """Folders with images as files."""

    name = "folder"

    @classmethod
    def detect(cls, path: str | Path) -> bool:
        """A folder with the lengths of episodes, and without videos."""
        path = Path(path)
        return (path / LENGTHS).exists() and not has_videos(path)

    @classmethod
    def open_reader(cls, path: str | Path, **kwargs: Any) -> FolderDataset:
        """A dataset of the folder."""
        return FolderDataset(path=path, **kwargs)

    @classmethod
    def open_writer(cls, path: str | Path, **kwargs: Any) -> FolderWriter:
        """A writer of the folder."""
        return FolderWriter(path, **kwargs)
