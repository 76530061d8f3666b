"""The table of formats: how a path is recognized, read and written. Formats of Python code stand beside the native ones.

A new format is a subclass of :class:`Format` under :func:`register_format`. :func:`~stable_worldmodel_rs.data.load_dataset`
and ``World.collect`` find it by its name; :class:`~stable_worldmodel_rs.data.Loader` reads native formats only.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar, runtime_checkable

__all__ = [
    "EPISODE_DATA_KEY",
    "FORMATS",
    "WRITE_MODES",
    "Format",
    "Writer",
    "detect_format",
    "get_format",
    "list_formats",
    "register_format",
    "split_episode_data",
    "validate_write_mode",
]

FORMATS: dict[str, type[Format]] = {}
"""Every known format, by name."""

WRITE_MODES = ("append", "overwrite", "error")
"""What a writer does about a dataset that exists: continue it (the default), replace it, or refuse."""

EPISODE_DATA_KEY = "_episode_data"
"""In the dict of an episode, ``{name: value}`` of what the episode has once, beside its columns."""

_MISSING = {
    "lance": "`load_dataset` without a format reads Lance tables, and `swm convert` makes HDF5 of them; to write some, build the wheel with Lance: `cargo xtask wheel --lance`",
    "lance_video": "convert the dataset with the reference's `swm convert` to HDF5",
}


def split_episode_data(ep_data: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The columns of an episode and its :data:`EPISODE_DATA_KEY` apart. The argument is left as it is."""
    if EPISODE_DATA_KEY not in ep_data:
        return ep_data, {}
    columns = {key: value for key, value in ep_data.items() if key != EPISODE_DATA_KEY}
    return columns, dict(ep_data[EPISODE_DATA_KEY] or {})


def validate_write_mode(mode: str) -> str:
    """The mode, if it is one of :data:`WRITE_MODES`."""
    if mode not in WRITE_MODES:
        raise ValueError(f"unknown write mode {mode!r}; the write mode must be one of {WRITE_MODES}")
    return mode


@runtime_checkable
class Writer(Protocol):
    """What takes whole episodes: a context manager with two methods. A ``list.append`` of one's own is enough of one.

    An episode is ``{column: values}``, ``(T, …)`` each or a list of T values, and may hold :data:`EPISODE_DATA_KEY` if
    the format has ``supports_episode_data``.
    """

    def __enter__(self) -> Writer: ...
    def __exit__(self, *exc: object) -> None: ...
    def write_episode(self, ep_data: dict[str, Any]) -> None:
        """Appends one episode."""
        ...

    def write_episodes(self, episodes: Iterable[dict[str, Any]]) -> None:
        """Appends several."""
        ...


class Format:
    """One way of storing a dataset.

    Example:
        >>> @register_format
        ... class Pickled(Format):
        ...     name = "pickled"
        ...     @classmethod
        ...     def detect(cls, path): return str(path).endswith(".pkl")
        ...     @classmethod
        ...     def open_reader(cls, path, **kwargs): return MyDataset(path, **kwargs)
    """

    name: ClassVar[str] = ""
    """Its name, for ``format=``."""
    supports_episode_data: ClassVar[bool] = False
    """Whether its writer keeps :data:`EPISODE_DATA_KEY`."""

    @classmethod
    def detect(cls, path: str | Path) -> bool:
        """Whether a path is of this format."""
        raise NotImplementedError(f"{cls.__name__}.detect must be implemented")

    @classmethod
    def open_reader(cls, path: str | Path, **kwargs: Any) -> Any:
        """Opens a dataset."""
        raise NotImplementedError(f"format {cls.name or cls.__name__!r} does not support reading")

    @classmethod
    def open_writer(cls, path: str | Path, **kwargs: Any) -> Any:
        """A :class:`Writer`; ``mode=`` is one of :data:`WRITE_MODES`."""
        raise NotImplementedError(f"format {cls.name or cls.__name__!r} does not support writing (it is read-only)")


_F = TypeVar("_F", bound=type[Format])


def register_format(cls: _F) -> _F:
    """Makes a format known under its ``name``; a decorator."""
    if not cls.name:
        raise ValueError(f"{cls.__name__} must set a non-empty `name`")
    if cls.name in FORMATS:
        raise ValueError(f"format {cls.name!r} is already registered, by {FORMATS[cls.name].__name__}")
    FORMATS[cls.name] = cls
    return cls


def list_formats() -> list[str]:
    """Names of all formats."""
    return list(FORMATS)


def get_format(name: str) -> type[Format]:
    """The format of a name."""
    if name in FORMATS:
        return FORMATS[name]
    near = difflib.get_close_matches(str(name), FORMATS, 1)
    hint = f"; {_MISSING[name]}" if name in _MISSING else f"; did you mean {near[0]!r}?" if near else ""
    raise ValueError(f"unknown format {name!r}; available: {list_formats()}{hint}")


def detect_format(path: str | Path) -> type[Format] | None:
    """The first format that knows a path, or ``None``."""
    return next((known for known in FORMATS.values() if known.detect(path)), None)
