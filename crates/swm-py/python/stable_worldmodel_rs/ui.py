"""The page in the browser: ``swm ui`` as a process of its own, from a script or a notebook."""

from __future__ import annotations

import atexit
import json
import subprocess
import sys
import webbrowser
from collections.abc import Sequence
from os import PathLike, fspath
from urllib.parse import quote

from .world.ids import native_id


class Page:
    """A page that is being served. In a notebook it shows itself as a frame.

    Args:
        paths: Datasets, results, training runs, or folders that hold them.
        env: The environment that the page opens with.
        save: The folder for recordings; None: nothing is written.
        notebook: The address of the notebook's page, such as ``http://localhost:8888``: it may then show this one in a frame.
        open_browser: Open the default browser; None: unless ``notebook`` is given.

    Attributes:
        url: The address. It works once: the browser that opens it first keeps a cookie.
    """

    url: str

    def __init__(
        self,
        *paths: str | PathLike[str],
        env: str | None = None,
        save: str | PathLike[str] | None = None,
        notebook: str | None = None,
        open_browser: bool | None = None,
    ) -> None:
        native = None if env is None else native_id(env) or env
        self._process = subprocess.Popen(
            _command([fspath(path) for path in paths], None if save is None else fspath(save), notebook),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        atexit.register(self.close)
        assert self._process.stdout is not None and self._process.stderr is not None
        text = ""
        while not text.rstrip().endswith("}"):
            line = self._process.stdout.readline()
            if not line:
                raise RuntimeError(self._process.stderr.read().strip() or "swm ui ended before it served a page")
            text += line
        self._notebook = notebook
        self.url = json.loads(text)["url"] + (f"#play?env={quote(native, safe='')}" if native else "")
        if notebook is None if open_browser is None else open_browser:
            webbrowser.open(self.url)

    def close(self) -> None:
        """End the server. What was recorded is in its files."""
        if self._process.poll() is None:
            self._process.terminate()
            self._process.wait(10)

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Page({self.url})"

    def _repr_html_(self) -> str:
        if self._notebook is None:
            return f'<a href="{self.url}" target="_blank">open the page</a>'
        return f'<iframe src="{self.url}" width="100%" height="800" style="border:0"></iframe>'


def _command(paths: Sequence[str], save: str | None, notebook: str | None) -> list[str]:
    words = [sys.executable, "-m", "stable_worldmodel_rs", "--json", "ui", "--no-open"]
    if save is not None:
        words += ["--save", save]
    if notebook is not None:
        # Cookies reach a frame of the same host only.
        host = notebook.split("://", 1)[-1].rsplit(":", 1)[0]
        words += ["--frame-from", notebook.rstrip("/"), "--host", host]
    return [*words, "--", *paths]
