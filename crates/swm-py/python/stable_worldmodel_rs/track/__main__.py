"""``python -m stable_worldmodel_rs.track RUN TRACKERS``: what ``swm train --track`` starts, and ends by closing its standard input.

On standard output: ``ready`` once the libraries are there, ``error REASON`` if they are not, or if a tracker fails later.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from pathlib import Path
from threading import Thread

from ._follow import Follower
from ._sinks import PROJECT

_PERIOD_S = 0.5


def main(arguments: list[str] | None = None) -> int:
    """Follow a run until standard input ends; gives the exit status."""
    parser = argparse.ArgumentParser(prog="python -m stable_worldmodel_rs.track", description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("trackers", help="names, with commas")
    parser.add_argument("--project", default=PROJECT)
    given = parser.parse_args(arguments)
    # A signal to the whole group is the training's to handle: it ends this program when its last checkpoint is written.
    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, signal.SIG_IGN)
    said = os.fdopen(os.dup(1), "w", encoding="utf-8")
    # Libraries print what they like.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    try:
        follower = Follower(given.run, given.trackers.split(","), project=given.project)
        said.write("ready\n")
        said.flush()
        is_over = Thread(target=_read_to_end, daemon=True)
        is_over.start()
        try:
            while is_over.is_alive():
                follower.poll()
                is_over.join(_PERIOD_S)
        finally:
            follower.finish()
    except Exception as error:  # noqa: BLE001  whatever a library raises is the reason
        reason = " ".join(str(error).split()) or type(error).__name__
        said.write(f"error {reason}\n")
        said.flush()
        return 1
    return 0


def _read_to_end() -> None:
    # Not by `sys.stdin`, whose lock would be held when the interpreter ends.
    while os.read(0, 4096):
        pass


if __name__ == "__main__":
    sys.exit(main())
