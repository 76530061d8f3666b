"""Tensors of published files, by name: `torch.save`, also of whole modules, Lightning's ``.ckpt``, safetensors. Nothing in a file is
executed."""

from __future__ import annotations

import json
import logging
import os
import pickle
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from ._pickle import read_objects
from ._torch import DType, Tensor, torch

__all__ = ["read_weights", "unwrapped", "write_safetensors"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")

# Copies of the model with averaged weights, which are left out.
_AVERAGED = ("ema.", "ema_model.", "model_ema.")
# What training keeps beside the model: losses, meters, probes, the inverse dynamics of PLDM, averages and their count.
_BESIDE = ("sigreg.", "idm.", "criterion", "val_", "train_", "_metrics", "callbacks_", "n_averaged", *_AVERAGED)
# Below these, files keep the tensors.
_HOMES = ("state_dict", "model_state_dict", "model")
# What wraps a whole model: torch.compile, several GPUs, training scripts.
_WRAPPERS = ("_orig_mod.", "module.", "model.")

_TYPES: dict[str, DType] = {
    "F64": torch.float64,
    "F32": torch.float32,
    "F16": torch.float16,
    "BF16": torch.bfloat16,
    "I64": torch.int64,
    "I32": torch.int32,
    "I16": torch.int16,
    "I8": torch.int8,
    "U8": torch.uint8,
    "BOOL": torch.bool,
}
_MOST_HEADER = 100 << 20


def read_weights(file: Path) -> dict[str, Tensor]:
    """The tensors of a file, floats as f32, under the names that the model itself gives them.

    Raises:
        ValueError: the file is no such file, is damaged, or has tensors that no model can use.
    """
    if file.is_dir():
        raise ValueError(f"{file} is a folder, and a file of weights was looked for; give the file")
    with file.open("rb") as stream:
        begin = stream.read(512)
    _check_begin(file, begin)
    zipped = begin.startswith(b"PK")
    known = not zipped and len(begin) > 9 and begin[8:9] == b"{"
    found: Any = _safetensors(file) if known else _torch_file(file, zipped)
    for home in _HOMES:
        if isinstance(found, Mapping) and isinstance(cast("dict[str, Any]", found).get(home), Mapping):
            found = cast("dict[str, Any]", found)[home]
    if not isinstance(found, Mapping):
        raise ValueError(f"{file} holds {type(found).__name__} and no tensors by name; give what state_dict() returns")
    tensors = _named(cast("Mapping[Any, Any]", found)) or {
        f"{part}.{name}": value
        for part, below in cast("Mapping[Any, Any]", found).items()
        if isinstance(below, Mapping)
        for name, value in _named(cast("Mapping[Any, Any]", below)).items()
    }
    if not tensors:
        raise ValueError(f"{file} holds no tensors; give the weights of a model, what state_dict() returns")
    return {name: _usable(file, name, value) for name, value in unwrapped(tensors).items()}


def _named(found: Mapping[Any, Any]) -> dict[str, Tensor]:
    return {str(name): value for name, value in found.items() if isinstance(value, Tensor)}


def _check_begin(file: Path, begin: bytes) -> None:
    """Refuses what a failed download leaves in the place of a file."""
    if not begin:
        raise ValueError(f"{file} is empty: the download failed; fetch it again")
    if begin.startswith(b"version https://git-lfs"):
        size = re.search(rb"size (\d+)", begin)
        size_text = f" ({int(size.group(1)):,} bytes)" if size else ""
        raise ValueError(f"{file} is a pointer of Git LFS, not the weights{size_text}: run `git lfs pull`, or fetch the file itself")
    if begin.lstrip().lower().startswith((b"<!doctype", b"<html")):
        raise ValueError(f"{file} is a web page in the place of the file: the download failed; fetch it again")


def _torch_file(file: Path, zipped: bool) -> Any:
    if zipped:
        with file.open("rb") as stream:
            stream.seek(max(0, file.stat().st_size - (1 << 17)))
            if b"PK\x05\x06" not in stream.read():
                size = file.stat().st_size
                raise ValueError(f"{file} is cut off ({size:,} bytes; its archive has no end): fetch it again")
    damaged = (RuntimeError, EOFError, OSError, KeyError, ValueError, IndexError, TypeError, AttributeError, pickle.UnpicklingError, zipfile.BadZipFile)
    try:
        if zipped:
            _compare_checksums(file)
        try:
            return torch.load(file, map_location="cpu", weights_only=True)
        except pickle.UnpicklingError:
            found, called = read_objects(file, zipped)
    except damaged as error:
        reason = f"{type(error).__name__}: {error}" if isinstance(error, KeyError) else error
        raise ValueError(f"{file} is no file of torch.save, or a damaged one: {reason}. Fetch it again") from error
    if called:
        logger.warning("%s would call %s if Python loaded it; ignored here. Do not load it with torch.load", file, ", ".join(called))
    return found


def _compare_checksums(file: Path) -> None:
    """Reads the records of an archive, which torch does without a look at their checksums."""
    with zipfile.ZipFile(file) as archive:
        if (spoiled := archive.testzip()) is not None:
            raise ValueError(f"the checksum of its record {spoiled} differs")


def _safetensors(file: Path) -> dict[str, Tensor]:
    data = file.read_bytes()
    length = int.from_bytes(data[:8], "little")
    try:
        if length > min(_MOST_HEADER, len(data) - 8):
            raise ValueError(f"its header has {length:,} bytes, and the file {len(data):,}")
        header = cast("dict[str, Any]", json.loads(data[8 : 8 + length]))
        body = memoryview(data)[8 + length :]
        found: dict[str, Tensor] = {}
        for name, what in header.items():
            if name == "__metadata__":
                continue
            begin, end = what["data_offsets"]
            kind = _TYPES[what["dtype"]]
            if not 0 <= begin <= end <= len(body):
                raise ValueError(f"{name} ends behind the file, which is cut off")
            flat = torch.frombuffer(bytearray(body[begin:end]), dtype=kind) if end > begin else torch.empty(0, dtype=kind)
            found[name] = flat.reshape(what["shape"])
        return found
    except (ValueError, KeyError, TypeError, RuntimeError, RecursionError) as error:
        raise ValueError(f"{file} is no valid file of safetensors: {error}. Fetch it again") from error


def write_safetensors(file: Path, tensors: Mapping[str, Tensor]) -> None:
    """Writes tensors as f32, whole or not at all."""
    header: dict[str, Any] = {"__metadata__": {"format": "pt"}}
    parts: list[bytes] = []
    end = 0
    for name, value in tensors.items():
        flat: Any = value.detach().cpu().float().contiguous()
        parts.append(flat.numpy().tobytes())
        header[name] = {"dtype": "F32", "shape": list(value.shape), "data_offsets": [end, end + len(parts[-1])]}
        end += len(parts[-1])
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    draft = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        draft.write_bytes(b"".join([len(text).to_bytes(8, "little"), text, *parts]))
        os.replace(draft, file)
    finally:
        draft.unlink(missing_ok=True)


def unwrapped(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Without what wraps a model and what is beside it."""
    wrapped = True
    while wrapped:
        wrapped = False
        for prefix in _WRAPPERS:
            inner = {name[len(prefix) :]: value for name, value in tensors.items() if name.startswith(prefix)}
            rest = [name for name in tensors if not name.startswith(prefix)]
            if inner and all(name.startswith(_BESIDE) for name in rest):
                if averaged := next((name for name in rest if name.startswith(_AVERAGED)), None):
                    logger.warning("the averaged copy of the weights (%s, …) is left out, and %s* are read", averaged, prefix)
                tensors, wrapped = inner, True
    return {name.replace("._orig_mod.", "."): value for name, value in tensors.items()}


def _usable(file: Path, name: str, value: Tensor) -> Tensor:
    if value.layout != torch.strided or value.is_quantized or value.is_complex():
        what = "complex" if value.is_complex() else "sparse or quantized"
        raise ValueError(f"{file}: {name} is {what}; models take dense tensors of real numbers")
    if value.numel() * value.element_size() > value.untyped_storage().nbytes():
        raise ValueError(f"{file}: {name} is a view of {value.numel():,} values over fewer that are stored; save its clone()")
    if not value.is_floating_point():
        return value.contiguous()
    value = value.float().contiguous()
    if not bool(torch.isfinite(value).all()):
        raise ValueError(f"{file}: {name} holds values that are not finite; the file is of no use")
    if name.endswith("running_var") and bool((value < 0).any()):
        raise ValueError(f"{file}: {name} holds negative variances; the file is of no use")
    return value
