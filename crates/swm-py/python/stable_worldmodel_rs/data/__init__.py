"""Datasets: reading clips of recorded episodes, writing, converting, training batches.

The quick way to train is :class:`Loader`; datasets are map-style and work with ``torch.utils.data.DataLoader``, too.

Example:
    >>> import stable_worldmodel_rs as swm
    >>> dataset = swm.data.load_dataset("pusht.h5", num_steps=4, frameskip=5)
    >>> for batch in swm.data.Loader(dataset, batch_size=64):
    ...     batch["pixels"]  # uint8 (64, 4, 3, H, W)
"""

from importlib import import_module as _import_module

from . import formats  # Registers them.
from .buffer import ReplayBuffer, classic_filter
from .contents import diff, inspect, preview, stats, verify
from .dataset import ClipIndices, ConcatDataset, Dataset, GoalDataset, MergeDataset
from .format import (
    EPISODE_DATA_KEY,
    FORMATS,
    WRITE_MODES,
    Format,
    Writer,
    detect_format,
    get_format,
    list_formats,
    register_format,
    split_episode_data,
    validate_write_mode,
)
from .formats.folder import FolderDataset, FolderWriter, ImageDataset
from .formats.hdf5 import HDF5Dataset, HDF5Writer
from .formats.lerobot import LeRobotAdapter, LeRobotWriter
from .formats.mcap import McapDataset, McapWriter
from .formats.video import VideoDataset, VideoWriter
from .loader import Loader, collate
from .native import NativeDataset
from .normalization import ColumnNormalizer, IdentityScaler, PercentileScaler, ZScoreScaler, column_normalizer, get_scaler
from .rerun import to_rerun
from .utils import (
    convert,
    download,
    ensure_dir_exists,
    get_cache_dir,
    load_dataset,
    merge,
    split,
    split_files,
    split_held_out,
)

__all__ = [
    "EPISODE_DATA_KEY",
    "FORMATS",
    "WRITE_MODES",
    "ClipIndices",
    "ColumnNormalizer",
    "ConcatDataset",
    "Dataset",
    "FolderDataset",
    "FolderWriter",
    "Format",
    "GoalDataset",
    "HDF5Dataset",
    "HDF5Writer",
    "IdentityScaler",
    "ImageDataset",
    "LeRobotAdapter",
    "LeRobotWriter",
    "Loader",
    "McapDataset",
    "McapWriter",
    "MergeDataset",
    "NativeDataset",
    "PercentileScaler",
    "ReplayBuffer",
    "VideoDataset",
    "VideoWriter",
    "Writer",
    "ZScoreScaler",
    "classic_filter",
    "collate",
    "column_normalizer",
    "convert",
    "detect_format",
    "diff",
    "download",
    "ensure_dir_exists",
    "formats",
    "get_cache_dir",
    "get_format",
    "get_scaler",
    "inspect",
    "list_formats",
    "load_dataset",
    "merge",
    "preview",
    "register_format",
    "split",
    "split_episode_data",
    "split_files",
    "split_held_out",
    "stats",
    "to_rerun",
    "validate_write_mode",
    "verify",
]



def __getattr__(name: str) -> object:
    """Classes of Lance tables: the core's, or those of an installed reference under ``compat.install()``."""
    if not name.startswith("Lance"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    native = _import_module(".formats.native_lance", __name__)
    compat = _import_module("stable_worldmodel_rs.compat")
    module = "lance_video" if name.startswith("LanceVideo") else "lance"
    if not native.IS_BUILT and compat.is_installed():
        try:
            return getattr(_import_module(f"stable_worldmodel.data.formats.{module}"), name)
        except ImportError:
            pass
    if module == "lance":
        return getattr(native, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}; videos in Lance tables are the reference's only")
