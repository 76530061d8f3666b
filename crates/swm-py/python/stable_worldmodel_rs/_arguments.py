"""What arguments are checked for before they go on: whole numbers, paths, devices, functions. Errors name the argument and what it is."""

from __future__ import annotations

import json
import operator
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from ._arrays import require_torch

__all__ = [
    "as_json",
    "chosen_episodes",
    "device_of",
    "home_path",
    "kind_of",
    "named_list",
    "names_of",
    "path_of",
    "request_text",
    "require_callable",
    "target_path",
    "whole_number",
]


def whole_number(name: str, value: Any, least: int = 0, most: int = 2**63 - 1) -> int:
    """A whole number, also of NumPy.

    Raises:
        TypeError: It is something else.
        ValueError: It is less than ``least``, or more than ``most``.
    """
    try:
        number = operator.index(value)
    except TypeError:
        bound = f" from {least} on" if least >= 0 else ""
        raise TypeError(f"{name}={value!r}: give a whole number{bound}, such as {name}={max(least, 8)}") from None
    if number < least:
        raise ValueError(f"{name}={number}: give {least} or more")
    if number > most:
        raise ValueError(f"{name}={number}: give a whole number from {least} to {most}")
    return number


def chosen_episodes(episodes: Sequence[int] | str | None) -> str | None:
    """Numbers of episodes as requests have them, ``"0,3,7"``; a text such as ``"0..10"`` is one already."""
    if episodes is None or isinstance(episodes, str):
        return episodes
    return ",".join(str(whole_number("episodes", episode)) for episode in episodes)


def kind_of(value: Any) -> str:
    """What a value is an object of."""
    return type(value).__name__


def path_of(name: str, value: Any, hint: str) -> str:
    """A path as text.

    Raises:
        TypeError: It is none; ``hint`` is what to give.
    """
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(cast("str | os.PathLike[str]", value))
    raise TypeError(f"{name} is {kind_of(value)}; give {hint}")


def target_path(name: str, value: Any) -> Path:
    """The path of what is written, with ``~`` as the home folder.

    Raises:
        TypeError: It is none.
    """
    return Path(path_of(name, value, "the path of a file or folder")).expanduser()


def named_list(name: str, value: Any) -> list[str]:
    """Names, given as a list.

    Raises:
        TypeError: A single text, whose letters would be the names, or no list of texts.
    """
    if isinstance(value, str):
        raise TypeError(f"{name}={value!r} is a text; give a list: [{value!r}]")
    try:
        return [str(one) for one in value]
    except TypeError:
        raise TypeError(f"{name}={value!r}: give a list of names") from None


def names_of(names: Sequence[str] | str | None) -> list[str] | None:
    """Names as a list; a single text is one name."""
    return None if names is None else [names] if isinstance(names, str) else list(names)


def home_path(name: str, value: Any) -> str | None:
    """A path as text, with ``~`` as the home folder; None stays None.

    Raises:
        TypeError: It is no path, such as a dataset that is open.
    """
    if value is None:
        return None
    opened = getattr(value, "path", None)
    hint = f"its path, {os.fspath(cast('Any', opened))!r}" if isinstance(opened, (str, os.PathLike)) else "a path"
    return str(Path(path_of(name, value, hint)).expanduser())


def as_json(name: str, value: Any) -> Any:
    """A setting as JSON has it: arrays, tensors and numbers of NumPy as lists and numbers, paths as text.

    Raises:
        TypeError: It holds something else; ``name`` is what is named.
        ValueError: A number in it is NaN or infinite, or it has more than 64 bits.
    """
    if isinstance(value, Mapping):
        given = cast("Mapping[Any, Any]", value)
        return {str(key): as_json(f"{name}[{key!r}]", one) for key, one in given.items()}
    if isinstance(value, int) and not -(1 << 63) <= value < 1 << 64:
        raise ValueError(f"{name}={value}: give a whole number from 0 to {(1 << 64) - 1}")
    try:
        return json.loads(json.dumps(value, default=_plain, allow_nan=False))
    except TypeError:
        raise TypeError(f"{name} is {kind_of(value)}; give text, numbers, or a list of them") from None
    except ValueError:
        raise ValueError(f"{name}={value!r}: a number is NaN or infinite; give a finite one") from None


def request_text(request: Mapping[str, Any], arguments: Mapping[str, str] | None = None) -> str:
    """A request as JSON; ``arguments`` are those that have another name in the core.

    Raises:
        TypeError: As `as_json`, of the argument.
        ValueError: As `as_json`, of the argument.
    """
    names = arguments or {}
    return json.dumps({setting: as_json(names.get(setting, setting), value) for setting, value in request.items()})


def _plain(value: Any) -> Any:
    """What JSON does not know as what it knows."""
    if hasattr(value, "detach"):
        value = value.detach().cpu()
        return value.tolist()
    if isinstance(value, (np.ndarray, np.generic)):
        return cast("Any", value).tolist()
    return os.fspath(cast("os.PathLike[str]", value)) if isinstance(value, os.PathLike) else operator.index(value)


def require_callable(name: str, value: Any, of: str) -> None:
    """Refuses what cannot be called, such as a list of functions.

    Raises:
        TypeError: It says what the function is given.
    """
    if value is not None and not callable(value):
        raise TypeError(f"{name} is {kind_of(value)}; give a function of {of}, which calls several one after the other")


def device_of(name: str, value: Any) -> Any:
    """A device of torch that is here.

    Raises:
        ValueError: torch knows none of that name, or finds none.
    """
    torch = require_torch(f"{name}= is a device of torch")
    try:
        device = torch.device(value)
    except (RuntimeError, TypeError):
        raise ValueError(f"{name}={value!r}: torch has no device of that name; give 'cpu', 'cuda', 'cuda:1' or 'mps'") from None
    backend: Any = {"cuda": getattr(torch, "cuda", None), "mps": getattr(getattr(torch, "backends", None), "mps", None)}.get(device.type)
    if backend is not None and not backend.is_available():
        raise ValueError(
            f"{name}={value!r}: torch {torch.__version__} finds no such device here (torch.{'cuda' if device.type == 'cuda' else 'backends.mps'}."
            f"is_available() is False); give {name}='cpu', or install the build of torch for your GPU and its driver"
        )
    return device
