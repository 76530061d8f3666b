"""The built-in formats, each a module with a reader, a writer and an entry of the table of formats."""

from . import native_lance, hdf5, folder, video, lerobot, mcap  # noqa: I001  (the order in which paths are tried)

__all__ = ["folder", "hdf5", "lerobot", "mcap", "native_lance", "video"]
