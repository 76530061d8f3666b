"""Datasets behind an address, on a server of this machine."""

from __future__ import annotations

import http.server
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import stable_worldmodel_rs as swm

COMMIT = "0123456789abcdef0123456789abcdef01234567"


class Handler(http.server.BaseHTTPRequestHandler):
    """Files of a folder with ranges, and a repository of the Hub with the same files."""

    folder: Path

    def do_GET(self) -> None:
        path = self.path.split("?")[0]
        if path.startswith("/api/datasets/user/repo/revision/"):
            return self.answer(200, json.dumps({"sha": COMMIT}).encode(), {})
        path = path.removeprefix(f"/datasets/user/repo/resolve/{COMMIT}")
        file = self.folder / path.lstrip("/")
        if not file.is_file():
            return self.answer(404, b"", {})
        content = file.read_bytes()
        headers = {"ETag": f'"{len(content)}-{file.stat().st_mtime_ns}"'}
        if "Range" not in self.headers:
            return self.answer(200, content, headers)
        first, last = self.headers["Range"].removeprefix("bytes=").split("-")
        part = content[int(first) : int(last) + 1]
        headers["Content-Range"] = f"bytes {first}-{int(first) + len(part) - 1}/{len(content)}"
        return self.answer(206, part, headers)

    def answer(self, status: int, content: bytes, headers: dict[str, str]) -> None:
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    folder = tmp_path / "served"
    folder.mkdir()
    handler = type("OfFolder", (Handler,), {"folder": folder})
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}", folder
    server.shutdown()


def run(code: str, url: str, cache: Path) -> subprocess.CompletedProcess[str]:
    """Runs code in a process with its own cache: the variables are read once."""
    import os

    env = {**os.environ, "SWM_CACHE": str(cache), "HF_ENDPOINT": url}
    return subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=120)


def test_datasets_open_by_their_address(server: tuple[str, Path], tmp_path: Path) -> None:
    url, folder = server
    states = np.arange(24, dtype=np.float32).reshape(6, 4)
    with swm.data.HDF5Writer(folder / "mine.h5") as writer:
        writer.write_episode({"state": states, "action": np.zeros((6, 2), np.float32)})
    for address in (f"{url}/mine.h5", "hf://datasets/user/repo@main/mine.h5"):
        code = (
            "import stable_worldmodel_rs as swm\n"
            f"dataset = swm.data.load_dataset({address!r})\n"
            "print(dataset.lengths.tolist(), float(dataset[0]['state'].sum()), dataset.path)"
        )
        done = run(code, url, tmp_path / "cache")
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip() == f"[6] {states[0].sum()} {address}"
        # Its size is logged before a file is fetched as a whole.
        assert f"fetching {address}: 0.0 MB" in done.stderr, done.stderr


def test_what_is_not_there_is_named(server: tuple[str, Path], tmp_path: Path) -> None:
    url, _ = server
    done = run(f"import stable_worldmodel_rs as swm\nswm.data.load_dataset({url + '/none.h5'!r})", url, tmp_path / "cache")
    assert "nothing is there (404)" in done.stderr and f"{url}/none.h5" in done.stderr, done.stderr
    secret = f"import stable_worldmodel_rs as swm\nswm.data.load_dataset({url.replace('//', '//me:SECRET@') + '/x.h5'!r})"
    done = run(secret, url, tmp_path / "cache")
    assert "a name and a password" in done.stderr, done.stderr
    assert "SECRET" not in done.stderr.splitlines()[-1]
