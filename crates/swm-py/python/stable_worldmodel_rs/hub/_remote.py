"""Folders to the Hub and back."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, cast

from .._arguments import target_path
from ..data.utils import download as download_dataset
from ..data.utils import load_dataset
from ..wm.utils import load_pretrained
from ._folders import dataset_in, is_hidden

AnyPath = str | os.PathLike[str]

# What one commit takes: a broken connection loses no more than that.
_FILES_PER_COMMIT = 50
_BYTES_PER_COMMIT = 1 << 30
_CARD = "README.md"
_TYPES = ("model", "dataset")


def push_to_hub(
    folder: AnyPath,
    repo_id: str,
    *,
    repo_type: str = "model",
    private: bool | None = None,
    revision: str | None = None,
    token: str | None = None,
) -> str:
    """Send a folder to a repository of the Hub, which is made if it is not there. The same call goes on where an earlier one stopped.

    Files whose content the repository has are not sent again; the card comes last, so that a repository with a card is whole. Files of the
    repository that the folder does not have stay.

    Args:
        folder: What `save_model`, `save_dataset` or `swm.bundle` wrote.
        repo_id: ``"user/repository"``.
        repo_type: ``"model"`` or ``"dataset"``.
        private: Whether a new repository is private; None: as the account has it.
        revision: The branch; None: the main one.
        token: Of the account; None: ``HF_TOKEN``, or what ``hf auth login`` kept.

    Returns:
        The address of the repository.

    Raises:
        ImportError: huggingface_hub is not installed.
        ValueError: The folder has no card with a license, or the arguments are wrong. Nothing is sent then.
    """
    _check(repo_id, repo_type)
    where = target_path("folder", folder)
    if not where.is_dir():
        raise NotADirectoryError(f"{where} is no folder; swm.hub.save_model, swm.hub.save_dataset and swm.bundle write one")
    files = sorted(_files(where))
    _check_card(where)
    hub = _hub("push_to_hub")
    api: Any = hub.HfApi(endpoint=os.environ.get("HF_ENDPOINT"), token=token)
    url = str(api.create_repo(repo_id, repo_type=repo_type, private=private, exist_ok=True))
    if revision is not None:
        api.create_branch(repo_id, branch=revision, repo_type=repo_type, exist_ok=True)
    there = {info.path: info for info in _infos(api, repo_id, repo_type, revision, files)}
    missing = [path for path in files if not (path in there and _is_same(where / path, there[path]))]
    # The card last.
    missing.sort(key=lambda path: (path == _CARD, path))
    for part in _parts(where, missing):
        operations = [hub.CommitOperationAdd(path_in_repo=path, path_or_fileobj=str(where / path)) for path in part]
        more = "" if len(part) == 1 else f" and {len(part) - 1} more"
        api.create_commit(repo_id, operations, commit_message=f"Add {part[0]}{more}", repo_type=repo_type, revision=revision)
    return url


def download(
    repo_id: str, *, repo_type: str = "model", revision: str | None = None, allow_patterns: Sequence[str] | None = None
) -> Path:
    """Fetch a repository of the Hub: the only function here that does. Files that are there are not fetched again.

    Args:
        repo_id: ``"user/repository"``.
        repo_type: ``"model"``, into the Hub's cache; or ``"dataset"``, to ``$STABLEWM_HOME/datasets``.
        revision: Branch, tag or commit; None: the newest.
        allow_patterns: Of a dataset, the files to fetch: ``["*.h5"]``; None: all.

    Returns:
        The folder with its files.

    Raises:
        ImportError: huggingface_hub is not installed.
    """
    _check(repo_id, repo_type)
    if repo_type == "dataset":
        return download_dataset(repo_id, revision=revision or "main", allow_patterns=allow_patterns)
    if allow_patterns is not None:
        raise ValueError("allow_patterns is for datasets; of a model, all files are fetched")
    return Path(_hub("download").snapshot_download(repo_id, revision=revision))


def from_pretrained(name: AnyPath, *, repo_type: str = "model", **options: Any) -> Any:
    """Open what is here: a folder, or a repository that `download` fetched. Nothing is fetched.

    Args:
        name: A folder of `save_model` or `save_dataset`, or ``"user/repository"``.
        repo_type: ``"model"`` or ``"dataset"``.
        **options: Of a model as of `load_pretrained`, of a dataset as of `load_dataset`.

    Returns:
        A torch module, or a dataset.

    Raises:
        FileNotFoundError: It is not here; the message has the call that fetches it.
    """
    if repo_type not in _TYPES:
        raise ValueError(f"repo_type={repo_type!r}: use 'model' or 'dataset'")
    if repo_type == "model":
        return load_pretrained(name, **options)
    from ..data.utils import get_cache_dir

    text = os.fspath(name)
    fetched = get_cache_dir(None, "datasets") / text.replace("/", "--")
    folder = next((path for path in (Path(text).expanduser(), fetched) if path.is_dir()), None)
    if folder is None:
        raise FileNotFoundError(f"{text!r} is neither a folder nor in {fetched.parent}; fetch it with swm.hub.download({text!r}, repo_type='dataset')")
    return load_dataset(dataset_in(folder.resolve()), **options)


def _check(repo_id: str, repo_type: str) -> None:
    if repo_id.count("/") != 1 or not all(repo_id.split("/")):
        raise ValueError(f"{repo_id!r} is no repository; give 'user/repository'")
    if repo_type not in _TYPES:
        raise ValueError(f"repo_type={repo_type!r}: use 'model' or 'dataset'")


def _check_card(folder: Path) -> None:
    """Refuses a folder that the Hub would show without a license."""
    card = folder / _CARD
    text = card.read_text(encoding="utf-8") if card.is_file() else ""
    parts = text.split("---\n", 2)
    if len(parts) < 3 or parts[0] or not any(line.startswith("license:") for line in parts[1].splitlines()):
        raise ValueError(
            f"{folder} has no {_CARD} whose metadata has a license; write the folder with swm.hub.save_model or swm.hub.save_dataset"
        )


def _files(folder: Path) -> Iterator[str]:
    for path in folder.rglob("*"):
        below = path.relative_to(folder)
        if path.is_file() and not any(is_hidden(part) for part in below.parts):
            yield below.as_posix()


def _hub(what: str) -> Any:
    try:
        return import_module("huggingface_hub")
    except ImportError as error:
        raise ImportError(f"{what} needs huggingface_hub; `pip install huggingface_hub`") from error


def _infos(api: Any, repo_id: str, repo_type: str, revision: str | None, files: Sequence[str]) -> list[Any]:
    found: list[Any] = []
    for first in range(0, len(files), 500):
        part = list(files[first : first + 500])
        found += cast("list[Any]", api.get_paths_info(repo_id, part, repo_type=repo_type, revision=revision))
    return [info for info in found if hasattr(info, "blob_id")]


def _is_same(path: Path, info: Any) -> bool:
    """Whether the repository has this content: by SHA-256 of a large file, by git's hash of another."""
    if path.stat().st_size != info.size:
        return False
    if info.lfs is not None:
        return _digest(path, hashlib.sha256()) == info.lfs.sha256
    head = f"blob {path.stat().st_size}\0".encode()
    return _digest(path, hashlib.sha1(head, usedforsecurity=False)) == info.blob_id


def _digest(path: Path, digest: Any) -> str:
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return str(digest.hexdigest())


def _parts(folder: Path, paths: Sequence[str]) -> Iterator[list[str]]:
    """Paths by commit; the card has one of its own."""
    part: list[str] = []
    size = 0
    for path in paths:
        length = (folder / path).stat().st_size
        if part and (path == _CARD or len(part) >= _FILES_PER_COMMIT or size + length > _BYTES_PER_COMMIT):
            yield part
            part, size = [], 0
        part.append(path)
        size += length
    if part:
        yield part
