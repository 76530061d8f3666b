"""What arguments are checked for before they go on: whole numbers, paths, devices, functions. Errors name the argument and what it is."""

from __future__ import annotations

import operator
import os
from typing import Any, cast

from ._arrays import require_torch

__all__ = ["device_of", "kind_of", "named_list", "path_of", "require_callable", "whole_number"]


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
