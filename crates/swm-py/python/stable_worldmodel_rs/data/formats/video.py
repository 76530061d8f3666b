"""Folders of videos: as :mod:`.folder`, with an MP4 file per episode in place of images. No FFmpeg is needed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from ..format import Format, register_format
from ..writers import NativeWriter
from .folder import LENGTHS, FolderDataset, has_videos

__all__ = ["Video", "VideoDataset", "VideoWriter"]


class VideoDataset(FolderDataset):
    """Clips of a folder with a video per episode.

    Args:
        video_keys: The columns that are videos; ``None``: all subfolders.

    The other arguments are those of :class:`.FolderDataset`.
    """

    def __init__(self, name: str | None = None, video_keys: Sequence[str] | None = None, **options: Any) -> None:
        super().__init__(name=name, folder_keys=options.pop("folder_keys", video_keys), **options)


class VideoWriter(NativeWriter):
    """Appends episodes to a folder; uint8 columns ``(T, H, W, 3)`` become one H.264 video per episode.

    Args:
        fps: Frames per second that players are told.
        codec: Only ``"libx264"`` (H.264) is written.
        quality: 1 to 100.
        key_frame_period: Frames from one key frame to the next; more is smaller, and slower to read at random.
    """

    native_format: ClassVar[str] = "video"
    _marker = LENGTHS

    def __init__(
        self,
        path: str | Path,
        fps: float = 25,
        codec: str = "libx264",
        *,
        mode: str | None = None,
        quality: int | None = None,
        key_frame_period: int | None = None,
        metadata: dict[str, Any] | None = None,
    ) -> None:
        if codec not in ("libx264", "h264"):
            raise ValueError(f"codec {codec!r} is not written; use 'libx264', or the reference's VideoWriter")
        super().__init__(path, mode=mode, quality=quality, metadata=metadata)
        self.fps: float | None = float(fps)
        self.codec = codec
        self.key_frame_period: int | None = key_frame_period


@register_format
class Video(Format):
    """Folders with videos."""

    name = "video"

    @classmethod
    def detect(cls, path: str | Path) -> bool:
        """A folder with the lengths of episodes and videos."""
        path = Path(path)
        return (path / LENGTHS).exists() and has_videos(path)

    @classmethod
    def open_reader(cls, path: str | Path, **kwargs: Any) -> VideoDataset:
        """A dataset of the folder."""
        return VideoDataset(path=path, **kwargs)

    @classmethod
    def open_writer(cls, path: str | Path, **kwargs: Any) -> VideoWriter:
        """A writer of the folder."""
        return VideoWriter(path, **kwargs)
