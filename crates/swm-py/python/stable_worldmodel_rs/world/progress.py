"""Progress bars by tqdm, where it is installed."""

from __future__ import annotations

from types import TracebackType
from typing import Any


class Progress:
    """A bar over episodes, updated from the loop that runs them.

    Example:
        >>> with Progress("Recording", total=10, enabled=False) as bar:
        ...     bar.tick(3, 0, 120)
    """

    def __init__(self, title: str, total: int, enabled: bool = True) -> None:
        self._bar: Any = None
        if not enabled:
            return
        try:
            from tqdm.auto import tqdm
        except ImportError:
            return
        self._bar = tqdm(total=total, desc=title, unit="episode", dynamic_ncols=True)

    def tick(self, episodes: int, successes: int, steps: int) -> None:
        """Show that ``episodes`` are over, ``successes`` of them successful, after ``steps`` steps."""
        bar = self._bar
        if bar is None:
            return
        if successes:
            bar.set_postfix_str(f"{successes} successful", refresh=False)
        bar.update(episodes - bar.n)

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()
