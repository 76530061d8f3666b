"""Receipts that are handed on with the model: paths from their own folder, found by the hashes of files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from copy import deepcopy
from pathlib import Path, PurePath
from typing import Any


def beside_model(receipt: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A receipt as it lies in ``results`` of the model's folder: its files are those of the folder, whatever they were called.

    Args:
        receipt: The receipt.
        folder: The model's folder.

    Raises:
        ValueError: It is of a model by a name or path whose files the folder does not have.
    """
    written = deepcopy(dict(receipt))
    here = {_sha256(path): path.relative_to(folder).as_posix() for path in sorted(folder.rglob("*")) if path.is_file()}
    files: dict[str, str] = {}
    roots: set[str] = set()
    for path, hash in dict(written.get("files") or {}).items():
        own = here.get(hash)
        named = next((text for text in _texts(written) if PurePath(path).is_relative_to(text)), None)
        if own is None and (named is not None or _is_of_the_zoo(written)):
            raise ValueError(
                f"results: the receipt of {written['policy']} is of {path}, which is not in the folder, or was changed since; evaluate the model "
                "that is saved, or leave the receipt out"
            )
        # A file of a policy in Python that is no part of the model: its name and its hash remain.
        files[f"../{own}" if own is not None else PurePath(path).name] = hash
        if own is not None and named is not None:
            roots.add(named)
    if not files:
        return written
    for value in _arguments(written):
        places: list[tuple[Any, Any]] = list(value.items()) if isinstance(value, dict) else list(enumerate(value))
        for name, text in places:
            if text in roots:
                value[name] = ".."
    return {**written, "files": files, "paths": [".."]}


def _arguments(receipt: Mapping[str, Any]) -> Iterator[dict[str, Any] | list[Any]]:
    """What holds arguments of policies: lists and dicts, to be changed in place."""
    for one in (receipt, *(receipt.get("references") or ())):
        policy = one["candidate"]["policy"]
        yield policy.get("positional") or []
        yield policy.get("named") or {}


def _texts(receipt: Mapping[str, Any]) -> list[str]:
    """Texts among the arguments of the policy itself."""
    policy = receipt["candidate"]["policy"]
    values: list[Any] = [*(policy.get("positional") or []), *dict(policy.get("named") or {}).values()]
    return [value for value in values if isinstance(value, str) and value]


def _is_of_the_zoo(receipt: Mapping[str, Any]) -> bool:
    return any(text.startswith("zoo:") for text in _texts(receipt)) or receipt["candidate"]["policy"]["name"] == "zoo"


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
