"""A server on this machine with as much of the Hub's protocol as an upload and a download take."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

# Files of this size and more are stored by LFS.
LARGE = 1000


class Hub:
    """Repositories by ``models/user/name``, each with its files; what was asked for; and when to break off."""

    def __init__(self) -> None:
        self.repos: dict[str, dict[str, bytes]] = {}
        self.large: dict[str, bytes] = {}
        self.commits: list[list[str]] = []
        self.sent: list[str] = []
        self.tokens: set[str] = set()
        self.cards: list[str] = []
        # Commits that are still taken; None: all.
        self.left: int | None = None
        self.address = ""

    def info(self, path: str, content: bytes) -> dict[str, Any]:
        entry: dict[str, Any] = {"type": "file", "path": path, "size": len(content)}
        entry["oid"] = hashlib.sha1(f"blob {len(content)}\0".encode() + content).hexdigest()
        if len(content) >= LARGE:
            entry["lfs"] = {"oid": hashlib.sha256(content).hexdigest(), "size": len(content), "pointerSize": 130}
        return entry

    def repo(self, kind: str, name: str) -> dict[str, Any]:
        files = self.repos[f"{kind}/{name}"]
        siblings = [{"rfilename": path} for path in sorted(files)]
        return {"id": name, "modelId": name, "sha": "c" * 40, "siblings": siblings, "tags": [], "private": False, "downloads": 0, "likes": 0}


def handler(hub: Hub) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, format: str, *args: Any) -> None:
            pass

        def body(self) -> bytes:
            if self.headers.get("Transfer-Encoding") == "chunked":
                whole = b""
                while length := int(self.rfile.readline().strip(), 16):
                    whole += self.rfile.read(length)
                    self.rfile.readline()
                self.rfile.readline()
                return whole
            return self.rfile.read(int(self.headers.get("Content-Length") or 0))

        def answer(self, content: Any, status: int = 200, **headers: str) -> None:
            data = content if isinstance(content, bytes) else json.dumps(content).encode()
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name.replace("_", "-"), value)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(data)

        def do_PUT(self) -> None:
            content = self.body()
            assert hashlib.sha256(content).hexdigest() == self.path.rsplit("/", 1)[-1]
            hub.large[self.path.rsplit("/", 1)[-1]] = content
            self.answer({})

        def do_POST(self) -> None:
            body, path = self.body(), unquote(urlsplit(self.path).path)
            hub.tokens.add(self.headers.get("Authorization") or "")
            if path == "/api/repos/create":
                asked = json.loads(body)
                kind = f"{asked.get('type') or 'model'}s"
                name = "/".join(filter(None, (asked.get("organization"), asked["name"])))
                is_new = f"{kind}/{name}" not in hub.repos
                hub.repos.setdefault(f"{kind}/{name}", {})
                prefix = "" if kind == "models" else f"{kind}/"
                self.answer({"url": f"{hub.address}/{prefix}{name}", "name": name}, 200 if is_new else 409)
                return
            if path == "/api/validate-yaml":
                hub.cards.append(json.loads(body)["content"])
                self.answer({"errors": [], "warnings": []})
                return
            if found := re.fullmatch(r"/(datasets/)?([^/]+/[^/]+)\.git/info/lfs/objects/batch", path):
                objects = json.loads(body)["objects"]
                upload = lambda one: {} if one["oid"] in hub.large else {"actions": {"upload": {"href": f"{hub.address}/lfs/{one['oid']}"}}}  # noqa: E731
                self.answer({"transfer": "basic", "objects": [{**one, **upload(one)} for one in objects]})
                return
            found = re.fullmatch(r"/api/(models|datasets)/([^/]+/[^/]+)/(paths-info|preupload|commit)/main", path)
            assert found, path
            files = hub.repos[f"{found[1]}/{found[2]}"]
            if found[3] == "paths-info":
                text = body.decode()
                wanted = json.loads(text)["paths"] if text.startswith("{") else parse_qs(text)["paths"]
                self.answer([hub.info(name, files[name]) for name in wanted if name in files])
            elif found[3] == "preupload":
                modes = [
                    {"path": one["path"], "uploadMode": "lfs" if one["size"] >= LARGE else "regular", "shouldIgnore": False, "oid": None}
                    for one in json.loads(body)["files"]
                ]
                self.answer({"files": modes})
            else:
                self.commit(files, [json.loads(line) for line in body.splitlines() if line.strip()], found[2])

        def commit(self, files: dict[str, bytes], lines: list[dict[str, Any]], name: str) -> None:
            if hub.left == 0:
                self.answer({"error": "the connection broke"}, 400)
                return
            hub.left = None if hub.left is None else hub.left - 1
            added = []
            for line in lines[1:]:
                value = line["value"]
                content = base64.b64decode(value["content"]) if line["key"] == "file" else hub.large[value["oid"]]
                files[value["path"]] = content
                added.append(value["path"])
            hub.commits.append(added)
            hub.sent += added
            oid = f"{len(hub.commits):040x}"
            self.answer({"success": True, "commitOid": oid, "commitUrl": f"{hub.address}/{name}/commit/{oid}", "hookOutput": ""})

        def do_HEAD(self) -> None:
            self.do_GET()

        def do_GET(self) -> None:
            path = unquote(urlsplit(self.path).path)
            if found := re.fullmatch(r"/api/(models|datasets)/([^/]+/[^/]+)(?:/revision/[^/]+)?", path):
                self.answer(hub.repo(found[1], found[2]))
            elif found := re.fullmatch(r"/api/(models|datasets)/([^/]+/[^/]+)/tree/[^/]+/?", path):
                files = hub.repos[f"{found[1]}/{found[2]}"]
                self.answer([hub.info(name, content) for name, content in sorted(files.items())])
            elif found := re.fullmatch(r"/(datasets/)?([^/]+/[^/]+)/resolve/[^/]+/(.+)", path):
                content = hub.repos[f"{'datasets' if found[1] else 'models'}/{found[2]}"][found[3]]
                self.answer(content, ETag=f'"{hashlib.sha256(content).hexdigest()}"', X_Repo_Commit="c" * 40)
            else:
                self.answer({"error": f"no {path}"}, 404)

    return Handler


@contextmanager
def hub_at_work() -> Iterator[Hub]:
    """The server, for as long as the context is open."""
    hub = Hub()
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler(hub))
    hub.address = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield hub
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
