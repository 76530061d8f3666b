"""Folders as repositories have them: the files of a model or dataset, and a card."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, cast

from .._arguments import path_of, target_path
from ..data.format import detect_format
from ..data.utils import load_dataset
from ..world.receipts import read_receipt
from ._cards import dataset_card, model_card
from ._results import beside_model

AnyPath = str | os.PathLike[str]

# What a training keeps for itself: locks, optimizers, logs, drafts.
_PRIVATE = (
    ".*", "lock", "*.lock", "*.training.safetensors", "training.state", "training.new", "events.out.tfevents.*", "new-*", "episodes.h5",
    "wandb", "mlruns", "mlartifacts", "mlflow.db", "tensorboard", "track.json", "__pycache__",
)  # fmt: skip

# What a recording keeps for itself: locks, drafts.
_PRIVATE_DATA = (".*", "*.lock", "new-*")

# Of the files that begin with a dot, these describe arrays of Zarr and are part of a dataset.
_ZARR = (".zarray", ".zgroup", ".zattrs", ".zmetadata")


def is_hidden(name: str) -> bool:
    """Whether a file or folder is no part of a model or dataset, by its dot."""
    return name.startswith(".") and name not in _ZARR


def save_model(
    source: AnyPath,
    folder: AnyPath,
    *,
    license: str,
    name: str | None = None,
    tags: Sequence[str] = (),
    env: str | None = None,
    results: Sequence[AnyPath | Mapping[str, Any]] = (),
) -> Path:
    """Write a folder as a repository of a model has it: its files and a card.

    Args:
        source: A folder of `save_pretrained`, a run of ``swm-rs train``, or an export to ONNX. What a training keeps for itself
            (optimizers, logs) is left out.
        folder: The folder to write; it must not be there.
        license: By its SPDX identifier, such as ``"mit"``.
        name: What the card calls it; None: the name of the source.
        tags: More tags.
        env: The environment's id; None: that of the first result, or of the run.
        results: Receipts of it, their files or folders: they are copied, with paths in the folder for those of this machine, and the card has
            their rates with intervals. ``swm.verify`` runs a copy again.

    Returns:
        The folder.

    Raises:
        FileExistsError: The folder is there.
        ValueError: The source is no model, or a result is of another one or of files that were changed since.
    """
    where = Path(path_of("source", source, "the folder of a model: save_pretrained writes one of a torch module")).expanduser()
    kind, found = _kind_of_model(where)
    receipts = [read_receipt(one) if isinstance(one, (str, os.PathLike)) else one for one in results]
    known = env or next((str(one["manifest"]["env"]) for one in receipts), found)
    with _new(folder) as draft:
        shutil.copytree(where, draft, dirs_exist_ok=True, ignore=_ignored)
        for number, receipt in enumerate(receipts):
            (draft / "results").mkdir(exist_ok=True)
            text = json.dumps(beside_model(receipt, draft), indent=2)
            (draft / "results" / f"receipt-{number}.json").write_text(text + "\n", encoding="utf-8")
        text = model_card(name or where.resolve().name, kind, _license(license), tags, known, receipts)
        (draft / "README.md").write_text(text, encoding="utf-8")
    return target_path("folder", folder)


def save_dataset(
    source: AnyPath, folder: AnyPath, *, license: str, name: str | None = None, tags: Sequence[str] = ()
) -> Path:
    """Write a folder as a repository of a dataset has it: its files and a card.

    Args:
        source: A dataset that this package reads.
        folder: The folder to write; it must not be there.
        license: By its SPDX identifier, such as ``"cc-by-4.0"``.
        name: What the card calls it; None: the name of the source.
        tags: More tags.

    Returns:
        The folder.

    Raises:
        FileExistsError: The folder is there.
        FileNotFoundError: There is no such dataset.
    """
    where = Path(path_of("source", source, "the path of a dataset")).expanduser()
    if not where.exists():
        raise FileNotFoundError(f"there is no dataset {where}")
    dataset = load_dataset(where.resolve())
    detected = detect_format(where)
    kind = "of another program" if detected is None else str(detected.name)
    with _new(folder) as draft:
        if where.is_dir():
            shutil.copytree(where, draft, dirs_exist_ok=True, ignore=_ignored_data)
        else:
            shutil.copy2(where, draft / where.name)
        text = dataset_card(
            name or where.resolve().stem, _license(license), [*_format_tags(kind), *tags], _configs(kind, where), _about(dataset, kind), _columns(dataset)
        )
        (draft / "README.md").write_text(text, encoding="utf-8")
    return target_path("folder", folder)


def dataset_in(folder: Path) -> Path:
    """The dataset in a repository's folder: the folder itself, or the one file or folder in it that is one."""
    if detect_format(folder) is not None:
        return folder
    inside = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".") and detect_format(path) is not None]
    if len(inside) == 1:
        return inside[0]
    if not inside:
        # Of another program: it is known by its content where it is opened.
        rest = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".") and path.name != "README.md"]
        return rest[0] if len(rest) == 1 and rest[0].is_file() else folder
    raise ValueError(f"{folder} holds {len(inside)} datasets: {', '.join(path.name for path in inside)}; open one by its path")


@contextmanager
def _new(folder: AnyPath) -> Generator[Path]:
    """A draft beside the folder, which takes its place when it is whole."""
    target = target_path("folder", folder)
    if target.exists() or target.is_symlink():
        raise FileExistsError(f"{target} exists; name a folder that is not there yet")
    target.parent.mkdir(parents=True, exist_ok=True)
    draft = target.with_name(f"new-{os.getpid()}-{target.name}")
    draft.mkdir()
    try:
        yield draft
        os.rename(draft, target)
    except BaseException:
        shutil.rmtree(draft, ignore_errors=True)
        raise


def _ignored(folder: str, names: list[str]) -> list[str]:
    return [name for name in names if any(fnmatch(name, pattern) for pattern in _PRIVATE)]


def _ignored_data(folder: str, names: list[str]) -> list[str]:
    return [name for name in names if name not in _ZARR and any(fnmatch(name, pattern) for pattern in _PRIVATE_DATA)]


def _license(license: str) -> str:
    if not license.strip() or "\n" in license:
        raise ValueError(f"license={license!r}: give an SPDX identifier, such as 'mit' or 'cc-by-4.0'")
    return license


def _kind_of_model(folder: Path) -> tuple[str, str | None]:
    """What a folder's model is, and the environment that it was trained in."""
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}")
    file = folder / "config.json"
    config: Any = {}
    if file.is_file():
        try:
            config = json.loads(file.read_text(encoding="utf-8"))
        except ValueError as error:
            raise ValueError(f"{file} is no JSON: {error}") from error
    if isinstance(config, dict) and config:
        settings = cast("dict[str, Any]", config)
        if "model_config" in settings or "agent" in settings:
            data: dict[str, Any] = settings.get("data") or {}
            return "a run of `swm train`", data.get("env") or settings.get("env")
        if any(folder.glob("*.pt")) or any(folder.glob("*.safetensors")):
            return "weights with a `config.json`", None
    if any(folder.glob("*.onnx")):
        return "an export to ONNX", None
    raise ValueError(
        f"{folder} holds no model: neither a run of `swm-rs train`, nor what swm.save_pretrained or swm.export writes (config.json with weights, or .onnx)"
    )


def _format_tags(kind: str) -> list[str]:
    return {"lerobot": ["LeRobot"], "lance": ["lance"]}.get(kind, [kind] if kind in ("hdf5", "mcap") else [])


def _configs(kind: str, path: Path) -> list[dict[str, Any]]:
    """Which files are the data, for the Hub's viewer."""
    data = path.name
    if path.is_dir():
        data = {"lerobot": "data/*/*.parquet", "lance": "data/*.lance"}.get(kind, "**/*")
    return [{"config_name": "default", "data_files": [{"split": "train", "path": data}]}]


def _about(dataset: Any, kind: str) -> dict[str, Any]:
    known: dict[str, Any] = getattr(dataset, "metadata", None) or {}
    lengths = dataset.lengths
    return {
        "environment": known.get("env"),
        "policy": known.get("policy"),
        "seed": known.get("seed"),
        "episodes": len(lengths),
        "steps": int(lengths.sum()),
        "format": kind,
    }


def _columns(dataset: Any) -> list[tuple[str, str, str]]:
    fields: dict[str, Any] = getattr(dataset, "_fields", {})
    return [(name, str(fields[name][1]), str(tuple(fields[name][2]))) for name in dataset.column_names if name in fields]
