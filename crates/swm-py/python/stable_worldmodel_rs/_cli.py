"""The script ``swm-rs``: the command ``swm``, from the package."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; gives its exit status.

    Args:
        arguments: What stands behind the command's name; None: this process's.
    """
    from ._core import core as _swm
    from ._files import offer_if_fits

    given = list(sys.argv[1:] if arguments is None else arguments)
    # Whether one of OGBench is made may stand in a manifest, a recording or a job.
    offer_if_fits()
    # `doctor` looks at the packages of this Python.
    os.environ.setdefault("SWM_PYTHON", sys.executable)
    # The command stops by itself at SIGINT. Python's handler would wait for it to return.
    before = signal.signal(signal.SIGINT, signal.SIG_DFL) if arguments is None else None
    try:
        return _swm.run_command(["swm-rs", *given], _launcher())
    finally:
        sys.stdout.flush()
        if before is not None:
            signal.signal(signal.SIGINT, before)


def _launcher() -> tuple[list[str], str]:
    """How tasks of a job start this package, on another machine with the same environment, and the file of the compiled half."""
    from ._core import core as _swm

    # `-P`: the task's folder may hold files that are called as modules of Python.
    safe = ["-P"] if sys.version_info >= (3, 11) else []
    words = [sys.executable, *safe, "-m", "stable_worldmodel_rs"] if sys.executable else []
    return words, str(_swm.__file__)


if __name__ == "__main__":
    sys.exit(main())
