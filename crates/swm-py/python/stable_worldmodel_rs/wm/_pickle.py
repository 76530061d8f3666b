"""Files of `torch.save` with whole modules and other objects, read without executing anything of them.

Each class and function that a file names becomes an inert record with that name. Tensors are made from the records of tensors alone, and
the records of modules give what their `state_dict()` would.
"""

from __future__ import annotations

import pickle
import pickletools
import zipfile
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Any, cast

from ._torch import DType, Tensor, torch

__all__ = ["read_objects"]

_MOST_PICKLE = 100 << 20
_MOST_OBJECTS = 1_000_000
_DEEPEST = 64
_LEGACY = 0x1950A86A20F9469CFC6C
_REBUILT = "torch._utils._rebuild_tensor_v2"
# A parameter, or a tensor of another class: the record of the tensor itself is among its arguments.
_WRAPPED = ("torch._utils._rebuild_parameter", "torch._utils._rebuild_parameter_with_state")
_TYPES: dict[str, DType] = {
    f"torch.{name}Storage": kind
    for name, kind in (
        ("Double", torch.float64),
        ("Float", torch.float32),
        ("Half", torch.float16),
        ("BFloat16", torch.bfloat16),
        ("Long", torch.int64),
        ("Int", torch.int32),
        ("Short", torch.int16),
        ("Char", torch.int8),
        ("Byte", torch.uint8),
        ("Bool", torch.bool),
    )
}
# What a checkpoint calls that was written as its writer meant it.
_USUAL = ("torch.", "collections.", "numpy.", "_codecs.encode", "copyreg.", "copy_reg.", "functools.partial", "pathlib.", "datetime.", "omegaconf.")
_USUAL_TYPES = frozenset("set frozenset dict list tuple bytearray complex slice range object int float".split())


class Record:
    """An object of a file: the name of its class, or of the function that would make it, with its arguments and attributes, and what is put into
    it as into a dict. Nothing else can be done with it."""

    name: str
    called: list[str]
    args: tuple[Any, ...]
    state: Any
    content: dict[Any, Any]

    def __new__(cls, *args: Any, **_kwargs: Any) -> Record:
        """In the place of an object."""
        record = super().__new__(cls)
        record.args, record.state, record.content = args, None, {}
        return record

    def __init__(self, *_args: Any, **_kwargs: Any) -> None:
        """In the place of a call; an object that is made without one does not come here."""
        module, _, last = self.name.rpartition(".")
        usual = self.name.startswith(_USUAL) or (module == "builtins" and last in _USUAL_TYPES)
        if not usual and self.name not in self.called:
            self.called.append(self.name)

    def __call__(self, *args: Any) -> Record:
        """What a function makes is called, too: another record."""
        return type(self)(*args)

    def __setstate__(self, state: Any) -> None:
        self.state = state

    def __setitem__(self, key: Any, value: Any) -> None:
        self.content[key] = value

    def append(self, _value: Any) -> None:
        """Lists and sets of other classes are not looked at."""

    add = extend = append


class _Storage:
    """Values in a row, which tensors are views of."""

    def __init__(self, name: str, key: str) -> None:
        self.name, self.key = name, key


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: IO[bytes]) -> None:
        super().__init__(BytesIO(_checked(stream)))
        self.called: list[str] = []
        self.storages: dict[str, _Storage] = {}
        self._classes: dict[str, type[Record]] = {}

    def find_class(self, module_name: str, global_name: str, /) -> type[Record]:
        name = f"{module_name}.{global_name}".replace("__builtin__.", "builtins.")
        if name not in self._classes:
            self._classes[name] = cast("type[Record]", type("Record", (Record,), {"name": name, "called": self.called}))
        return self._classes[name]

    def persistent_load(self, pid: Any, /) -> Any:
        what, kind, *rest = pid
        if what == "module":  # A class, with its source.
            return kind
        if what != "storage" or (len(rest) > 3 and rest[3] is not None):
            raise ValueError(f"its pickle refers to a {what} in a form that is not read")
        return self.storages.setdefault(str(rest[0]), _Storage(kind.name, str(rest[0])))


def _checked(stream: IO[bytes]) -> bytes:
    """The bytes of the next pickle of a stream.

    The unpickler makes room for as many objects as the largest number by which one is called; here that is at most as many as there are bytes.
    """
    start = stream.tell()
    largest = 0
    for opcode, argument, at in pickletools.genops(stream):
        if (at or 0) > start + _MOST_PICKLE:
            raise ValueError(f"its pickle has more than {_MOST_PICKLE:,} bytes")
        if opcode.name.startswith("EXT"):
            raise ValueError(f"its pickle has the opcode {opcode.name}")
        if "PUT" in opcode.name:
            largest = max(largest, int(cast("int", argument)))
    end = stream.tell()
    stream.seek(start)
    if largest > end - start:
        raise ValueError(f"its pickle calls an object by number {largest:,}, and has {end - start:,} bytes")
    return stream.read(end - start)


class _Tensors:
    """Makes tensors of records; ``read`` gives the bytes of a storage."""

    def __init__(self, read: Callable[[_Storage], bytes]) -> None:
        self._read = read
        self._flat: dict[str, Tensor] = {}
        self._count = 0

    def tensor(self, record: Record) -> Tensor | None:
        """None: the record is of something else.

        Raises:
            ValueError: a tensor that no model can use.
        """
        if record.name in _WRAPPED and record.args and isinstance(record.args[0], Record):
            return self.tensor(record.args[0])
        if record.name == "torch._tensor._rebuild_from_type_v2" and len(record.args) > 2:
            function, _, arguments, *_ = record.args
            if getattr(function, "name", None) == _REBUILT:
                return self._view(*arguments[:4])
        if record.name == _REBUILT:
            return self._view(*record.args[:4])
        if record.name.startswith("torch._utils._rebuild_"):
            raise ValueError(f"a tensor is made by {record.name}; models take dense tensors of real numbers")
        return None

    def _view(self, storage: Any, offset: int, size: Any, stride: Any) -> Tensor:
        kind = _TYPES.get(storage.name)
        if kind is None:
            raise ValueError(f"a tensor is of {storage.name}; models take dense tensors of real numbers")
        if storage.key not in self._flat:
            data = bytearray(self._read(storage))
            self._flat[storage.key] = torch.frombuffer(data, dtype=kind) if data else torch.empty(0, dtype=kind)
        return torch.as_strided(self._flat[storage.key], tuple(size), tuple(stride), offset)

    def _enter(self, depth: int) -> None:
        """Objects may contain each other, and themselves."""
        self._count += 1
        if depth > _DEEPEST or self._count > _MOST_OBJECTS:
            raise ValueError(f"its objects are nested more than {_DEEPEST} deep, or more than {_MOST_OBJECTS:,}; no model is so")

    def plain(self, value: Any, depth: int = 0) -> Any:
        """Records of modules as what their `state_dict()` gives, of tensors as tensors, and dicts of such; None of all else."""
        self._enter(depth)
        if isinstance(value, Record) and (found := self.tensor(value)) is not None:
            return found
        state: Any = value.state if isinstance(value, Record) else None
        if isinstance(state, dict) and "_parameters" in state:
            return dict(self._module(cast("dict[str, Any]", state), "", depth))
        below = value.content if isinstance(value, Record) else value
        if not isinstance(below, dict):
            return None
        return {key: self.plain(one, depth + 1) for key, one in cast("dict[Any, Any]", below).items() if isinstance(key, str)}

    def _module(self, state: dict[str, Any], prefix: str, depth: int) -> Iterator[tuple[str, Tensor]]:
        self._enter(depth)
        idle: Any = state.get("_non_persistent_buffers_set", ())
        if isinstance(idle, Record):  # Before protocol 4, a set is a call with a list.
            idle = idle.args[0] if idle.args else ()
        for name, value in [*_items(state["_parameters"]), *_items(state.get("_buffers"))]:
            if name not in idle and isinstance(value, Record) and (found := self.tensor(value)) is not None:
                yield prefix + name, found
        for name, module in _items(state.get("_modules")):
            below = module.state if isinstance(module, Record) else None
            if isinstance(below, dict) and "_parameters" in below:
                yield from self._module(cast("dict[str, Any]", below), f"{prefix}{name}.", depth + 1)


def _items(of: Any) -> list[tuple[str, Any]]:
    """What is in a dict, or in a record of one."""
    content: Any = of.content if isinstance(of, Record) else of
    return [(str(name), value) for name, value in cast("dict[Any, Any]", content or {}).items()]


def read_objects(file: Path, zipped: bool) -> tuple[Any, list[str]]:
    """What is in a file of `torch.save`, by name: tensors, and dicts of them. And the functions that Python would call.

    Raises:
        ValueError, KeyError, ...: it is damaged, or has tensors that no model can use.
    """
    with file.open("rb") as stream:
        return _zipped(stream) if zipped else _legacy(stream)


def _zipped(stream: IO[bytes]) -> tuple[Any, list[str]]:
    with zipfile.ZipFile(stream) as archive:
        entries = {one.filename for one in archive.infolist() if one.compress_type == zipfile.ZIP_STORED}
        root = next((name[: -len("data.pkl")] for name in entries if name.rpartition("/")[2] == "data.pkl"), None)
        if root is None:
            raise ValueError("it has no data.pkl")
        if f"{root}byteorder" in entries and archive.read(f"{root}byteorder") != b"little":
            raise ValueError("its values are big-endian, which are not read")

        def read(storage: _Storage) -> bytes:
            name = f"{root}data/{storage.key}"
            if name not in entries:
                raise ValueError(f"it has no {name}")
            return archive.read(name)

        unpickler = _Unpickler(BytesIO(archive.read(f"{root}data.pkl")))
        return _Tensors(read).plain(unpickler.load()), unpickler.called


def _legacy(stream: IO[bytes]) -> tuple[Any, list[str]]:
    """The form of before PyTorch 1.6: pickles one after the other, then the values of each storage."""
    if _Unpickler(stream).load() != _LEGACY:
        raise ValueError("it does not begin as files of torch.save do")
    for _ in ("its version", "sizes of types"):
        _Unpickler(stream).load()
    unpickler = _Unpickler(stream)
    found = unpickler.load()
    values: dict[str, bytes] = {}
    for key in _Unpickler(stream).load():
        kind: Any = _TYPES.get(unpickler.storages[key].name)
        if kind is None:
            raise ValueError(f"a tensor is of {unpickler.storages[key].name}; models take dense tensors of real numbers")
        values[key] = stream.read(int.from_bytes(stream.read(8), "little") * kind.itemsize)
    return _Tensors(lambda storage: values[storage.key]).plain(found), unpickler.called
