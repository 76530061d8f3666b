"""What a path is that is no dataset, and what its owner can do: the second half of the messages of ``load_dataset``."""

from __future__ import annotations

import difflib
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

from .format import detect_format

__all__ = ["nearest_names", "what_it_is"]

_WRITE = "and write it with `HDF5Writer`: docs/own-data.md"
_VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".gif")
_IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
_PACKED = (".zip", ".tar", ".gz", ".tgz", ".xz", ".zst", ".bz2", ".7z", ".rar")
_WEIGHTS = (".pt", ".pth", ".ckpt", ".safetensors")
# Of a folder, so many entries are looked at, and so many are named.
_MOST_ENTRIES = 5000
_NAMED = 3


def what_it_is(path: Path) -> str | None:
    """The reason and the fix for a path that is no dataset; None where nothing but its content tells."""
    if path.is_dir():
        return _folder(path)
    suffix = path.suffix.lower()
    if suffix in _VIDEOS:
        return f"it is a video, without actions and states; read its images, such as with imageio or OpenCV, {_WRITE}"
    if suffix in _IMAGES:
        return f"it is one image; a dataset has episodes of rows: read it, such as with Pillow, {_WRITE}"
    if suffix in _PACKED:
        return "it is a packed archive; unpack it, and give what is in it"
    if suffix in (".pkl", ".pickle"):
        return f"it is a pickle of Python, which is not read, as it can execute anything; load it where you trust it, {_WRITE}"
    text = _text(path)
    if text is None:
        return None
    if suffix in (".csv", ".tsv"):
        return f"it is a table of text; read it, such as with pandas.read_csv, {_WRITE}"
    if suffix == ".toml" and "[[pairs]]" in text or "pairs = [" in text and suffix == ".toml":
        return "it is a manifest of evaluations; `swm.read_manifest` reads it"
    if suffix == ".json" and '"candidate"' in text:
        return "it is the receipt of an evaluation; `swm.read_receipt` reads it"
    first = text.strip().splitlines()[0][:40] if text.strip() else ""
    return f"it is a file of text, which begins with {first!r}; give the dataset itself, or read it {_WRITE}"


def _text(path: Path) -> str | None:
    """The beginning of a file of text; None of any other."""
    with path.open("rb") as file:
        begin = file.read(4096)
    if not begin or b"\0" in begin:
        return None
    try:
        return begin.decode()
    except UnicodeDecodeError as error:
        # A character may be cut in two at the end.
        return begin[: error.start].decode() if error.start > len(begin) - 4 else None


def _folder(path: Path) -> str | None:
    entries: list[Path] = []
    for entry in path.iterdir():
        entries.append(entry)
        if len(entries) >= _MOST_ENTRIES:
            break
    entries = sorted(entry for entry in entries if not entry.name.startswith("."))
    if not entries:
        return "it is an empty folder: a download, or unpacking, may have failed; give the file or folder of a dataset"
    names = {entry.name for entry in entries}
    if {"config.json", "checkpoints"} <= names:
        return "it is a run of `swm train`, which holds a model and no episodes; the policy `mpc:FOLDER` plans with it"
    if inside := [entry.name for entry in entries[:100] if _is_dataset(entry)]:
        return f"it holds datasets ({_some(inside)}) and is none itself; give one of them, or join them by `swm.data.merge`"
    kinds: tuple[tuple[Sequence[str], Callable[[list[Path]], str]], ...] = (
        (_VIDEOS, _videos),
        ((".npz",), _archives),
        ((".npy",), lambda files: f"it holds {len(files)} arrays of NumPy ({_names(files)}); read them with numpy.load, {_WRITE}"),
        (_IMAGES, lambda files: f"it holds {len(files)} images ({_names(files)}), without actions and states; read them, {_WRITE}"),
        (_WEIGHTS, lambda files: f"it holds weights of a model ({_names(files)}) and no episodes; `swm.load_pretrained` reads them"),
    )
    for suffixes, describe in kinds:
        if files := [entry for entry in entries if entry.suffix.lower() in suffixes and entry.is_file()]:
            return describe(files)
    return f"it holds {_some([entry.name for entry in entries])}, and nothing of a known format; give the file or folder of a dataset"


def _is_dataset(entry: Path) -> bool:
    try:
        return detect_format(entry) is not None
    except OSError:
        return False


def _videos(files: list[Path]) -> str:
    return (
        f"it holds {len(files)} videos ({_names(files)}), and nothing that says what was done: no actions, no states, no `ep_len.npz`; read "
        f"their images, such as with imageio or OpenCV, {_WRITE}"
    )


def _archives(files: list[Path]) -> str:
    """Of archives of NumPy: whether they have the same columns."""
    columns: dict[str, frozenset[str]] = {}
    for file in files:
        try:
            with zipfile.ZipFile(file) as archive:
                columns[file.name] = frozenset(name.removesuffix(".npy") for name in archive.namelist())
        except (OSError, zipfile.BadZipFile):
            return f"it holds {len(files)} archives of NumPy, of which {file.name} cannot be read; make it anew, or remove it"
    first = next(iter(columns))
    for name, found in columns.items():
        if found != columns[first]:
            return (
                f"it holds {len(files)} archives of NumPy with different columns: {first} has {_some(sorted(columns[first]), 9)}, and {name} has "
                f"{_some(sorted(found), 9)}; give all episodes the same columns, {_WRITE}"
            )
    return (
        f"it holds {len(files)} archives of NumPy ({_some(sorted(columns[first]), 9)} in each), which are not read as they are; for one "
        f"episode each, `writer.write_episode(dict(numpy.load(file)))` for every file, with `HDF5Writer`: docs/own-data.md"
    )


def _names(files: list[Path]) -> str:
    return _some([file.name for file in files])


def _some(names: Sequence[str], most: int = _NAMED) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def nearest_names(path: Path) -> str:
    """For a path that does not exist, what of its folder may have been meant; empty where that says nothing."""
    folder = path.parent
    if not folder.is_dir():
        existing = next((one for one in folder.parents if one.is_dir()), None)
        return "" if existing is None or existing == Path() else f"; there is no folder {folder}"
    names = sorted(entry.name for entry in folder.iterdir() if not entry.name.startswith("."))
    near = difflib.get_close_matches(path.name, names, 1)
    return f"; did you mean {str(folder / near[0])!r}?" if near else ""
