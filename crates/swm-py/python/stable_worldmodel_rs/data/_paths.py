"""Where datasets lie: the folder that the reference uses, too."""

from __future__ import annotations

import logging
import os
from pathlib import Path
from typing import Any, cast

from .._access import access_checked
from .._arguments import home_path, path_of
from .._core import core as _swm
from ._wrong import nearest_names

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")
DEFAULT_CACHE_DIR = Path.home() / ".stable_worldmodel"


@access_checked
def get_cache_dir(override_root: str | Path | None = None, sub_folder: str | None = None) -> Path:
    """The folder of the user's data: ``override_root``, else ``$STABLEWM_HOME``, else ``~/.stable_worldmodel``.

    It is made if it does not exist. ``sub_folder`` is ``"datasets"`` for datasets.
    """
    root = override_root or os.environ.get("STABLEWM_HOME") or Path("~/.stable_worldmodel").expanduser()
    folder = Path(root, sub_folder) if sub_folder else Path(root)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def datasets_folder(cache_dir: str | Path | None = None) -> Path:
    """The folder of datasets, whether or not it is there: what only reads makes none."""
    return Path(cache_dir or os.environ.get("STABLEWM_HOME") or Path("~/.stable_worldmodel").expanduser()) / "datasets"


def ensure_dir_exists(path: str | Path) -> None:
    """Makes a folder, if it is not there."""
    Path(path).mkdir(parents=True, exist_ok=True)


def resolve(name: str | Path | None, path: str | Path | None, folder: str | Path | None, suffix: str, what: str) -> Path:
    """The file of a dataset: ``path``, or ``name`` in ``folder``."""
    if path is not None:
        return Path(path)
    if name is None:
        raise TypeError(f"{what} requires either `name` or `path`")
    return Path(datasets_folder() if folder is None else folder, f"{name}{suffix}")


def find_dataset(name: str, datasets: Path) -> Path:
    """A dataset by its name in a folder, by its path, or by the repository that it was fetched from.

    What begins with ``.``, ``~`` or ``/`` is a path, and no name in the folder.
    """
    if name.startswith((".", "~")) or Path(name).is_absolute():
        path = Path(os.path.expanduser(name))
        if path.exists():
            return path
        raise FileNotFoundError(f"{name!r} does not exist{nearest_names(path)}")
    kept, here = datasets / name, Path(name)
    if kept.exists():
        if here.exists() and not kept.samefile(here):
            logger.warning("%s is read, and not the dataset of the same name in the working directory; %r is that one", kept, f"./{name}")
        return kept
    if here.exists():
        return here
    if "/" in name:
        fetched = datasets / name.replace("/", "--")
        if fetched.is_dir() and any(fetched.iterdir()):
            return fetched
        raise FileNotFoundError(f"{name!r} is neither in {datasets} nor here{nearest_names(here)}; fetch it with swm.data.download({name!r})")
    raise FileNotFoundError(f"{name!r} is neither in {datasets} nor a path{nearest_names(here)}")


def dataset_place(name: str, source: str | Path, cache_dir: str | Path | None) -> str:
    """Where a dataset is: its address, or its path, which can be read."""
    if not isinstance(cast("Any", source), (str, os.PathLike)):
        path_of(name, source, "the path of a dataset")
    path = str(source) if _swm.is_remote(str(source)) else find_dataset(str(source), datasets_folder(cache_dir))
    if isinstance(path, Path) and path.is_file():
        path.open("rb").close()  # What may not be read is no damaged dataset.
    return str(path)


def recorded(name: str, value: Any) -> str:
    """Where the dataset of a request is: its address, or the file that ``load_dataset`` opens.

    Raises:
        TypeError: It is no path, such as a dataset that is open.
        FileNotFoundError: There is none.
    """
    home_path(name, value)  # Refuses what is no path.
    return str(value) if _swm.is_remote(str(value)) else str(find_dataset(str(value), datasets_folder()))
