"""Progress bars by tqdm, where it is installed."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Any

# Seconds between two updates of a bar: on a terminal, and in a file, as of the command.
_LIVE_PERIOD = 0.1
_FILE_PERIOD = 10.0


class Progress:
    """A bar over episodes, updated from the loop that runs them. Where stderr is a file, it is a line every ten seconds at most.

    Args:
        title: What is done.
        total: Episodes of a bar; 0: not known.
        enabled: Whether to show one.
        parts: There are several bars one after the other, each begun by :meth:`begin`.

    Example:
        >>> with Progress("Recording", total=10, enabled=False) as bar:
        ...     bar.tick(3, 0, 120)
    """

    def __init__(self, title: str, total: int = 0, enabled: bool = True, parts: bool = False) -> None:
        self._bar: Any = None
        self._title = title
        self._enabled = enabled
        if not parts:
            self._open(title, total, "episodes")

    def _open(self, title: str, total: int, unit: str) -> None:
        if not self._enabled:
            return
        try:
            from tqdm.auto import tqdm
        except ImportError:
            return
        # The output of a notebook's kernel is no terminal, and yet shows bars.
        live = "ipykernel" in sys.modules or (sys.stderr is not None and sys.stderr.isatty())
        self._bar = tqdm(total=total or None, desc=title, unit=f" {unit}", dynamic_ncols=True, mininterval=_LIVE_PERIOD if live else _FILE_PERIOD)

    def begin(self, label: str, total: int, unit: str) -> None:
        """Leave the bar that there is as it stands, and show another one, called ``label``, of ``total`` units."""
        self._close()
        self._open(f"{self._title} {label}", total, unit)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def tick(self, done: int, successes: int, steps: int) -> None:
        """Show that ``done`` units are over; of episodes, ``successes`` are successful, after ``steps`` steps."""
        bar = self._bar
        if bar is None:
            return
        if successes:
            bar.set_postfix_str(f"{successes} successful", refresh=False)
        if done != bar.n:
            bar.update(done - bar.n)

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()
