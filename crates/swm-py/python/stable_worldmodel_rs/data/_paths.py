"""Where datasets lie: the folder that the reference uses, too."""

from __future__ import annotations

import os
from pathlib import Path

from .._access import access_checked

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
