"""One error for every file or folder that the system does not let this process read or write."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import wraps
from typing import Any, TypeVar, cast

from ._swm import DataError, SwmError

__all__ = ["FilePermissionError", "access_checked", "checked_access"]

_F = TypeVar("_F", bound=Callable[..., Any])
# How the core words it: 13 is EACCES, 1 is EPERM, 30 a file system that is read-only; on Windows, 5 is denied access.
_CODES = "5" if sys.platform == "win32" else "13|1|30"
_DENIED = re.compile(rf"\(os error (?:{_CODES})\)")
_PLACE = re.compile(r"^(?:.*?: )?(?:cannot|failed to) [a-z]+ (?:to )?(?:the folder )?(?P<path>.+?): ")


class FilePermissionError(DataError, PermissionError):
    """The system does not let this process read or write a file or folder.

    It is a ``DataError`` and Python's ``PermissionError``, whichever part of the package met it.
    """


FilePermissionError.__module__ = "stable_worldmodel_rs"


@contextmanager
def checked_access(path: Any = None) -> Generator[None]:
    """Makes one error of what the core, Python and libraries raise where a file may not be read or written.

    Args:
        path: The file or folder, where the error does not name it.

    Raises:
        FilePermissionError: It names the file or folder.
    """
    try:
        yield
    except FilePermissionError:
        raise
    except PermissionError as error:
        if error.filename is None and path is None:
            raise  # Of no file: from elsewhere.
        raise FilePermissionError(_message(error.filename or path)) from error
    except SwmError as error:
        text = str(error)
        if _DENIED.search(text) is None:
            raise
        found = _PLACE.match(text)
        raise FilePermissionError(_message(found["path"] if found else path)) from error


def access_checked(function: _F) -> _F:
    """The same for a whole function; a decorator."""

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        with checked_access():
            return function(*args, **kwargs)

    return cast("_F", call)


def _message(path: Any) -> str:
    place = "a file" if path is None else str(path)
    return (
        f"{place}: permission denied; give a place that you may read and write, or change who may: `ls -ld` shows the owner and the "
        "mode of the file and of its folder"
    )
