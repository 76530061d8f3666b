"""``World.show``: the page in the browser, served by a process of its own."""

from __future__ import annotations

import http.client
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs.ui import Page


def get(url: str) -> tuple[int, str, dict[str, str]]:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.netloc, timeout=20)
    connection.request("GET", f"{parts.path}?{parts.query}")
    answer = connection.getresponse()
    return answer.status, answer.read().decode(), {name.lower(): value for name, value in answer.getheaders()}


def test_a_world_opens_the_page_on_its_environment(tmp_path: Path) -> None:
    world = swm.World("swm/PushT-v1", image_shape=(32, 32), threads=1)
    with world.show(tmp_path, open_browser=False) as page:
        assert page.url.endswith("#play?env=swm%2FPushT-v1")
        assert "open the page" in page._repr_html_()
        status, text, headers = get(page.url)
        assert status == 200 and "app.js" in text
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert get(page.url)[0] == 401, "the token works once"
    with pytest.raises(OSError):
        get(page.url)


def test_a_notebook_shows_the_page_in_a_frame() -> None:
    with Page(notebook="http://localhost:8888") as page:
        assert page.url.startswith("http://localhost:")
        assert page._repr_html_().startswith("<iframe")
        assert get(page.url)[2]["content-security-policy"].endswith("frame-ancestors http://localhost:8888")


def test_what_cannot_be_shown_is_said(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="nowhere"):
        Page(tmp_path / "nowhere")
