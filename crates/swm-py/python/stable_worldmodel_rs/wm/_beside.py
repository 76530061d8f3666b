"""What a folder has beside weights and config: notes of an export of ``swm``, and an encoder that the config names."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from ._images import HALF
from ._names import of_generation
from ._shapes import BACKBONE
from ._vit import KNOWN, Vit
from ._weights import write_safetensors

__all__ = ["replace_file", "see_as_exported", "write_encoder", "write_normalization"]

_NOTES = "swm.json"
_MOST = 1 << 20


def see_as_exported(model: Any, folder: Path) -> None:
    """Normalizes images as the notes of a folder have it, which the config cannot have.

    Raises:
        ValueError: they cannot be read.
    """
    file = folder / _NOTES
    if not file.is_file() or file.stat().st_size > _MOST or not hasattr(model, "image_mean"):
        return
    try:
        found: Any = json.loads(file.read_text(encoding="utf-8"))
        half = found["set"].get("normalization") == "half"
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{file} is damaged: {error!r}; export the run again") from error
    if half:
        model.image_mean = model.image_std = HALF


def write_normalization(folder: Path, model: Any) -> None:
    """Notes how the model normalizes images, where that is not as the notes have it, or as ImageNet's where there are none."""
    if not hasattr(model, "image_mean"):
        return
    # What an export noted of scales and of the environment stays.
    notes = _read(folder / _NOTES) or {"version": 1}
    known: Any = notes.get("set")
    settings: dict[str, Any] = cast("dict[str, Any]", known) if isinstance(known, dict) else {}
    half = model.image_mean == HALF
    if half != (settings.get("normalization") == "half"):
        replace_file(folder / _NOTES, {**notes, "set": {**settings, "normalization": "half" if half else "imagenet"}})


def write_encoder(folder: Path, name: str, vit: Vit) -> None:
    """Writes the sizes of an encoder whose name says none of them to the file where ``load_pretrained`` looks for its heads.

    One of no published name gets its weights beside them, too: the reference reads both in the place of a repository.
    """
    own, sizes = folder / name, vit.sizes
    if name in KNOWN or not own.resolve().is_relative_to(folder.resolve()):
        return
    known: dict[str, Any] = {
        "hidden_size": sizes.dim,
        "num_hidden_layers": sizes.depth,
        "num_attention_heads": sizes.heads,
        "image_size": sizes.positions_for,
        "patch_size": sizes.patch,
    }
    found = _read(own / "config.json")
    if found is not None and all(found.get(name) == value for name, value in known.items()):
        return
    if sizes.dinov2:
        # A whole number as such: transformers 5 takes no float.
        ratio = sizes.hidden // sizes.dim if sizes.hidden % sizes.dim == 0 else sizes.hidden / sizes.dim
        known |= {"architectures": ["Dinov2Model"], "model_type": "dinov2", "mlp_ratio": ratio, "use_mask_token": sizes.mask_token}
    else:
        known |= {"architectures": ["ViTModel"], "model_type": "vit", "intermediate_size": sizes.hidden}
    own.mkdir(parents=True, exist_ok=True)
    if name == BACKBONE:
        # All versions of transformers read the old names in its files.
        tensors: dict[str, Any] = cast("Any", vit).state_dict()
        write_safetensors(own / "model.safetensors", {of_generation(at, 4, sizes.dinov2): value for at, value in tensors.items()})
    replace_file(own / "config.json", known)


def replace_file(file: Path, settings: Mapping[str, Any]) -> None:
    """Writes settings, whole or not at all."""
    draft = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        draft.write_text(json.dumps(settings, indent=2), encoding="utf-8")
        os.replace(draft, file)
    finally:
        draft.unlink(missing_ok=True)


def _read(file: Path) -> dict[str, Any] | None:
    """The settings in a file; None where it has none."""
    if not file.is_file() or file.stat().st_size > _MOST:
        return None
    try:
        found: Any = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return None
    return cast("dict[str, Any]", found) if isinstance(found, dict) else None
