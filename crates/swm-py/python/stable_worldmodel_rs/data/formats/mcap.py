"""MCAP: a log file that Foxglove and ROS tools play."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from ..format import Format, register_format
from ..native import NativeDataset
from ..writers import NativeWriter

__all__ = ["Mcap", "McapDataset", "McapWriter"]


class McapDataset(NativeDataset):
    """Clips of an MCAP file; the arguments are those of :class:`~stable_worldmodel_rs.data.native.NativeDataset`."""

    native_format: ClassVar[str | None] = "mcap"


class McapWriter(NativeWriter):
    """Appends episodes to an MCAP file."""

    native_format: ClassVar[str] = "mcap"


@register_format
class Mcap(Format):
    """MCAP files."""

    name = "mcap"

    @classmethod
    def detect(cls, path: str | Path) -> bool:
        """By the file extension."""
        return Path(path).suffix == ".mcap"

    @classmethod
    def open_reader(cls, path: str | Path, **kwargs: Any) -> McapDataset:
        """A dataset of the file."""
        return McapDataset(path, **kwargs)

    @classmethod
    def open_writer(cls, path: str | Path, **kwargs: Any) -> McapWriter:
        """A writer of the file."""
        return McapWriter(path, **kwargs)
