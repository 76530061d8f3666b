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
    from ._files import offer_ogbench

    given = list(sys.argv[1:] if arguments is None else arguments)
    if any("swm/OGB" in argument for argument in given):
        offer_ogbench()
    # `doctor` looks at the packages of this Python.
    os.environ.setdefault("SWM_PYTHON", sys.executable)
    # The command stops by itself at SIGINT. Python's handler would wait for it to return.
    before = signal.signal(signal.SIGINT, signal.SIG_DFL) if arguments is None else None
    try:
        return _swm.run_command(["swm-rs", *given])
    finally:
        sys.stdout.flush()
        if before is not None:
            signal.signal(signal.SIGINT, before)


if __name__ == "__main__":
    sys.exit(main())
