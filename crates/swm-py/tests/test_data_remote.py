"""Datasets behind an address, on a server of this machine: as plain files, as a repository of the Hub, and as a bucket of S3."""

from __future__ import annotations

import hashlib
import http.server
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import parse_qs, quote, unquote, urlsplit
from xml.sax.saxutils import escape

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm

FIELD = Path(__file__).parents[3] / "tests" / "golden" / "field"
COMMIT = "0123456789abcdef0123456789abcdef01234567"
SECRETS = {"AWS_ACCESS_KEY_ID": "THEKEY", "AWS_SECRET_ACCESS_KEY": "THESECRET", "HF_TOKEN": "THETOKEN"}


class Handler(http.server.BaseHTTPRequestHandler):
    """Files of a folder with ranges; the same as the repository ``user/repo``, and as the bucket ``bucket``, which want a login."""

    folder: Path
    asked: list[str]

    def do_GET(self) -> None:
        self.asked.append(self.path)
        parts = urlsplit(self.path)
        path, query = unquote(parts.path).lstrip("/"), parse_qs(parts.query)
        login = self.headers.get("Authorization", "")
        if "/datasets/user/repo/" in "/" + path and login != "Bearer THETOKEN":
            return self.answer(401, b"", {})
        if path.startswith("bucket/") and not login.startswith("AWS4-HMAC-SHA256 Credential=THEKEY/"):
            return self.answer(403, b"<Error><Code>AccessDenied</Code></Error>", {})
        if path.startswith("api/datasets/user/repo/revision/"):
            return self.answer(200, json.dumps({"sha": COMMIT}).encode(), {})
        tree = f"api/datasets/user/repo/tree/{COMMIT}/"
        if path.startswith(tree):
            return self.list_tree(path.removeprefix(tree))
        if "list-type" in query:
            return self.list_bucket(query["prefix"][0])
        for start in (f"datasets/user/repo/resolve/{COMMIT}/", "bucket/"):
            path = path.removeprefix(start)
        return self.file(self.folder / path)

    def files(self, prefix: str) -> list[Path]:
        return sorted(file for file in (self.folder / prefix).rglob("*") if file.is_file())

    def list_tree(self, prefix: str) -> None:
        files = self.files(prefix)
        nodes = [
            {"type": "file", "path": file.relative_to(self.folder).as_posix(), "size": file.stat().st_size, "oid": self.tag(file)}
            for file in files
        ]
        self.answer(200 if files else 404, json.dumps(nodes).encode(), {})

    def list_bucket(self, prefix: str) -> None:
        text = "<ListBucketResult><IsTruncated>false</IsTruncated>"
        for file in self.files(prefix):
            key, size = escape(file.relative_to(self.folder).as_posix()), file.stat().st_size
            text += f"<Contents><Key>{key}</Key><Size>{size}</Size><ETag>{escape(self.tag(file))}</ETag></Contents>"
        self.answer(200, (text + "</ListBucketResult>").encode(), {})

    def tag(self, file: Path) -> str:
        return f'"{hashlib.sha256(file.read_bytes()).hexdigest()[:16]}"'

    def file(self, file: Path) -> None:
        if not file.is_file():
            return self.answer(404, b"", {})
        content, headers = file.read_bytes(), {"ETag": self.tag(file)}
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


class Server:
    """What is served, and processes that read it: variables are read once by a process."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.cache, self.asked = folder / "served", folder / "cache", list[str]()
        self.folder.mkdir()
        handler = type("OfFolder", (Handler,), {"folder": self.folder, "asked": self.asked})
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        own = {"SWM_CACHE": str(self.cache), "HF_ENDPOINT": self.url, "AWS_ENDPOINT_URL": self.url, **SECRETS}
        done = subprocess.run(words, env={**os.environ, **own}, capture_output=True, text=True, timeout=300)
        for secret in SECRETS.values():
            assert secret not in done.stdout + done.stderr
        return done

    def python(self, code: str) -> subprocess.CompletedProcess[str]:
        start = "import logging\nimport stable_worldmodel_rs as swm\nlogging.basicConfig()\n"
        return self.run(sys.executable, "-c", start + code)

    def addresses(self, path: str) -> list[str]:
        return [f"{self.url}/{quote(path)}", f"s3://bucket/{path}", f"hf://datasets/user/repo@main/{path}"]


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    server = Server(tmp_path)
    yield server
    server.server.shutdown()


def make(folder: Path) -> list[str]:
    """Datasets of six formats: their names."""
    states = np.arange(48, dtype=np.float32).reshape(12, 4)
    images = np.random.default_rng(0).integers(0, 256, (12, 16, 16, 3), dtype=np.uint8)
    with swm.data.HDF5Writer(folder / "mine.h5") as writer:
        for first in (0, 6):
            rows = slice(first, first + 6)
            writer.write_episode({"pixels": images[rows], "state": states[rows], "action": states[rows, :2] / 50})
    for name, kind in (("mine.folder", "folder"), ("mine.mcap", "mcap"), ("mine.lerobot", "lerobot")):
        swm.data.convert(folder / "mine.h5", folder / name, dest_format=kind, progress=False)
    for name in ("pusht_cchi_v7_replay.zarr", "pointmaze-medium-navigate-v0.npz"):
        subprocess.run(["cp", "-r", str(FIELD / name), str(folder / name)], check=True)
    return ["mine.h5", "mine.folder", "mine.mcap", "mine.lerobot", "pusht_cchi_v7_replay.zarr", "pointmaze-medium-navigate-v0.npz"]


READ = """
import hashlib, json, sys
import numpy as np
def read(path):
    dataset = swm.data.load_dataset(path)
    columns = {}
    for episode in range(len(dataset.lengths)):
        for name, values in dataset.load_episode(episode).items():
            columns.setdefault(name, hashlib.sha256()).update(np.asarray(values).tobytes())
    return {"lengths": dataset.lengths.tolist(), **{name: found.hexdigest() for name, found in columns.items()}}
"""


def test_every_format_opens_by_its_address(server: Server) -> None:
    pairs = []
    for name in make(server.folder):
        is_folder = (server.folder / name).is_dir()
        # A server of plain HTTP gives no lists.
        pairs += [(str(server.folder / name), address) for address in server.addresses(name)[1 if is_folder else 0 :]]
    done = server.python(READ + f"for here, there in {pairs!r}:\n    print(json.dumps([there, read(here), read(there)]))")
    assert done.returncode == 0, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == len(pairs) == 15
    for there, expected, columns in found:
        assert columns == expected, there
        assert len(columns) > 1, there
    # Its size is logged before a file is fetched as a whole; what is read by position is not.
    assert "fetching s3://bucket/mine.h5: 0.8 MB" in done.stderr, done.stderr
    assert "fetching s3://bucket/mine.mcap" not in done.stderr and ".npz" not in done.stderr, done.stderr
    for file in server.cache.rglob("*"):
        content = file.read_bytes() if file.is_file() else b""
        assert not any(secret.encode() in content or secret in str(file) for secret in SECRETS.values()), file


def test_commands_take_addresses(server: Server, command: str, tmp_path: Path) -> None:
    make(server.folder)
    http, s3, hub = server.addresses("mine.h5")
    for address, name in ((http, "mine.h5"), ("s3://bucket/pusht_cchi_v7_replay.zarr", "pusht_cchi_v7_replay.zarr"), (hub, "mine.h5")):
        shown = json.loads(server.run(command, "inspect", address, "--json").stdout)
        assert shown["format"] and shown["episodes"] >= 2, shown
        out = str(tmp_path / f"{hashlib.sha256(address.encode()).hexdigest()[:8]}.h5")
        done = server.run(command, "convert", address, out)
        assert done.returncode == 0, done.stderr
        done = server.run(command, "diff", out, str(server.folder / name))
        assert done.returncode == 0, done.stdout + done.stderr
        assert server.run(command, "verify", address).returncode == 0
    done = server.run(command, "diff", s3, str(server.folder / "mine.h5"))
    assert done.returncode == 0, done.stdout + done.stderr
    done = server.run(command, "verify", s3, "--fix")
    assert done.returncode == 2 and "lies elsewhere" in done.stderr, done.stderr
    done = server.run(command, "merge", s3, s3, "--out", str(tmp_path / "twice.h5"))
    assert done.returncode == 2 and "named twice" in done.stderr, done.stderr
    done = server.run(command, "convert", str(server.folder / "mine.h5"), "s3://bucket/new.h5")
    assert done.returncode == 2 and "are read, not written" in done.stderr, done.stderr
    done = server.run(command, "inspect", "s3://bucket/none.h5")
    assert done.returncode == 2 and "s3://bucket/none.h5" in done.stderr and "nothing is there (404)" in done.stderr, done.stderr


def test_whole_datasets_are_fetched(server: Server, command: str, tmp_path: Path) -> None:
    make(server.folder)
    done = server.run(command, "fetch", "s3://bucket/mine.lerobot", "--out", str(tmp_path / "own.lerobot"), "--json")
    assert done.returncode == 0, done.stderr
    files = [file for file in (server.folder / "mine.lerobot").rglob("*") if file.is_file()]
    assert json.loads(done.stdout)["files"] == len(files)
    for file in files:
        assert (tmp_path / "own.lerobot" / file.relative_to(server.folder / "mine.lerobot")).read_bytes() == file.read_bytes()
    done = server.run(command, "fetch", "s3://bucket/mine.lerobot", "--out", str(tmp_path / "own.lerobot"))
    assert done.returncode == 2 and "exists already" in done.stderr, done.stderr
    done = server.run(command, "fetch", str(tmp_path))
    assert done.returncode == 2 and "is no address" in done.stderr, done.stderr


def test_functions_take_addresses(server: Server, tmp_path: Path) -> None:
    make(server.folder)
    s3 = "s3://bucket/mine.h5"
    code = (
        f"swm.data.convert({s3!r}, {str(tmp_path / 'copy.h5')!r}, progress=False)\n"
        f"dataset = swm.data.load_dataset({s3!r}, num_steps=2, image_size=(8, 8))\n"
        "print(dataset.path, dataset[0]['pixels'].shape)\n"
        f"print(swm.data.verify({s3!r}, progress=False)['ok'])\n"
    )
    done = server.python(code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [f"{s3} (2, 3, 8, 8)", "True"]
    copy, own = (swm.data.load_dataset(path) for path in (tmp_path / "copy.h5", server.folder / "mine.h5"))
    assert np.array_equal(copy.get_col_data("state"), own.get_col_data("state"))


def test_requests_take_addresses(server: Server, command: str, tmp_path: Path) -> None:
    room = "swm/TwoRoom-v2"
    collect = [command, "collect", room, "--policy", "random", "--episodes", "4", "--max-steps", "12", "--image-size", "none", "--quiet"]
    subprocess.run([*collect, "--out", str(server.folder / "room.h5")], check=True)
    code = (
        f"room, address = {room!r}, 's3://bucket/room.h5'\n"
        f"task = {str(tmp_path / 'task.toml')!r}\n"
        "print(len(swm.make_manifest(task, room, dataset=address, episodes=2, goal_offset=3)['pairs']))\n"
        "print(swm.replay(address, progress=False)['ok'])\n"
        "print(swm.measure(room, dataset=address, rows=4, horizon=2, plans=2, progress=False)['stride'])\n"
    )
    done = server.python(code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["2", "True", "1"], done.stdout


def test_a_dataset_that_is_here_asks_no_server(server: Server) -> None:
    make(server.folder)
    done = server.python(READ + f"read({str(server.folder / 'pointmaze-medium-navigate-v0.npz')!r})")
    assert done.returncode == 0, done.stderr
    assert server.asked == []


@pytest.mark.skipif(not _swm.HAS_TRAINING, reason="this build has no training")
def test_a_model_is_trained_on_an_address(server: Server, tmp_path: Path) -> None:
    values = np.random.default_rng(0)
    states = values.normal(size=(60, 4)).astype(np.float32)
    pixels = values.integers(0, 256, size=(60, 64, 64, 3), dtype=np.uint8)
    with swm.data.HDF5Writer(server.folder / "images.h5") as writer:
        for first in range(0, 60, 20):
            rows = slice(first, first + 20)
            writer.write_episode({"pixels": pixels[rows], "proprio": states[rows], "action": states[rows, :2]})
    code = f"swm.train('gcbc', 's3://bucket/images.h5', {str(tmp_path / 'run')!r}, preset='small', steps=2, batch=4, progress=False)\n"
    done = server.python(code)
    assert done.returncode == 0, done.stderr
    assert "s3://bucket/images.h5" in (tmp_path / "run" / "config.json").read_text()


def test_what_is_not_there_is_named(server: Server) -> None:
    done = server.python(f"swm.data.load_dataset({server.url + '/none.h5'!r})")
    assert "nothing is there (404)" in done.stderr and f"{server.url}/none.h5" in done.stderr, done.stderr
    secret = server.url.replace("//", "//me:SECRET@") + "/x.h5"
    done = server.python(f"swm.data.load_dataset({secret!r})")
    assert "a name and a password" in done.stderr, done.stderr
    assert "SECRET" not in done.stderr.splitlines()[-1]
    done = server.python("swm.data.load_dataset('hf://datasets/user/repo/none.h5')")
    assert "hf://datasets/user/repo/none.h5" in done.stderr and "404" in done.stderr, done.stderr
    with pytest.raises(ValueError, match="leave it out"):
        swm.data.load_dataset("s3://bucket/mine.h5", format="hdf5")
