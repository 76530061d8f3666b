"""Results that are handed on: bundles that verify elsewhere, boards of them."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stable_worldmodel_rs as swm


class Gain:
    """A policy in Python that depends on a file."""

    def __init__(self, gain: float) -> None:
        self.gain = gain

    def get_action(self, infos: dict[str, Any]) -> Any:
        toward = infos["goal_state"][:, 0, 2:4] - infos["state"][:, 0, :2]
        return (self.gain * toward).clip(-1, 1).astype(np.float32)


@pytest.fixture
def task(tmp_path: Path) -> Path:
    path = tmp_path / "task.toml"
    swm.make_manifest(path, "swm/PushT-v1", episodes=3, budget=6)
    return path


def result(task: Path, policy: Any, folder: str, **more: Any) -> Path:
    out = task.parent / folder
    swm.evaluate(task, policy, out, references=["random"], progress=False, **more)
    return out


def test_a_bundle_verifies_where_nothing_else_is(task: Path, tmp_path: Path) -> None:
    made = swm.bundle(result(task, "random", "result"), tmp_path / "bundle", reported=10.0, source="a paper")
    assert made["bundle"] == str(tmp_path / "bundle") and not made["is_foreign"]
    elsewhere = tmp_path / "elsewhere" / "moved"
    elsewhere.parent.mkdir()
    shutil.move(tmp_path / "bundle", elsewhere)
    task.unlink()
    shutil.rmtree(tmp_path / "result")
    assert swm.verify(elsewhere, progress=False)["equal"]
    receipt = elsewhere / "receipt.json"
    receipt.write_text(receipt.read_text() + " ")
    with pytest.raises(swm.SwmError, match=r"receipt\.json was changed"):
        swm.verify(elsewhere, progress=False)


def test_a_policy_in_python_travels_by_its_files(task: Path, tmp_path: Path) -> None:
    weights = tmp_path / "gain.txt"
    weights.write_text("0.02")
    folder = result(task, Gain(0.02), "mine", name="gain", weights=[weights])
    made = swm.bundle(folder, tmp_path / "bundle", license="mit")
    assert made["is_foreign"] and (tmp_path / "bundle" / "model" / "gain.txt").read_text() == "0.02"
    weights.unlink()
    assert swm.verify(tmp_path / "bundle", Gain(0.02), progress=False)["equal"]
    differing = swm.verify(tmp_path / "bundle", Gain(0.01), progress=False)
    assert not differing["equal"] and "gain" in differing["differences"]["solver"]


class Scale:
    """What a policy is made of, with a path of its own."""

    def __init__(self, file: Path | str) -> None:
        self._source = str(file)
        self.gain = float(Path(file).read_text())


class FromFile:
    """A policy that keeps the path of its weights: an attribute, and one in an object that it holds."""

    def __init__(self, weights: Path | str, scale: Scale, others: list[str]) -> None:
        self.weights, self.scale, self.others = weights, scale, others

    def get_action(self, infos: dict[str, Any]) -> Any:
        return Gain(self.scale.gain).get_action(infos)


@pytest.mark.parametrize("kind", [Path, str])
def test_paths_of_weights_may_change_and_their_content_may_not(kind: Any, task: Path, tmp_path: Path) -> None:
    def made(file: Path) -> FromFile:
        return FromFile(kind(file), Scale(kind(file)), [str(file), "plain"])

    weights = tmp_path / "gain.txt"
    weights.write_text("0.02")
    folder = result(task, made(weights), "mine", weights=[weights])
    settings = swm.read_receipt(folder)["candidate"]["policy"]["named"]
    assert settings["weights"].startswith("gain.txt#") and settings["others"] == [settings["weights"], "plain"], settings
    assert str(tmp_path) not in json.dumps(settings)
    swm.bundle(folder, tmp_path / "bundle", license="mit")
    weights.unlink()
    elsewhere = tmp_path / "elsewhere"
    shutil.move(tmp_path / "bundle", elsewhere)
    found = swm.verify(elsewhere, made(elsewhere / "model" / "gain.txt"), progress=False)
    assert found["equal"], found
    other = tmp_path / "other" / "gain.txt"
    other.parent.mkdir()
    other.write_text("0.020")
    found = swm.verify(elsewhere, made(other), progress=False)
    assert not found["equal"] and "weights" in found["differences"]["solver"], found


def test_wrong_requests_name_arguments_of_python(task: Path, tmp_path: Path) -> None:
    folder = result(task, "random", "result")
    (tmp_path / "taken").mkdir()
    with pytest.raises(swm.SwmError, match=r"exists, and a bundle is never changed; give another out"):
        swm.bundle(folder, tmp_path / "taken")
    with pytest.raises(swm.SwmError, match=r"source=.* give reported, or leave out source"):
        swm.bundle(folder, tmp_path / "new", source="a paper")
    with pytest.raises(FileNotFoundError, match="there is no receipt"):
        swm.bundle(tmp_path / "none", tmp_path / "new")
    with pytest.raises(swm.SwmError, match="it is a result"):
        swm.board([folder], tmp_path / "board")
    assert not (tmp_path / "new").exists() and not (tmp_path / "board").exists()


def test_a_board_needs_nothing_else(task: Path, tmp_path: Path) -> None:
    bundles = []
    for policy in ("random", "constant"):
        bundles.append(tmp_path / f"{policy}-bundle")
        swm.bundle(result(task, policy, policy), bundles[-1], reported=50.0, source="<arXiv>")
    made = swm.board(bundles, tmp_path / "board", title="PushT", rerun=True, progress=False)
    html = Path(made["page"]).read_text()
    assert html.count("&lt;arXiv&gt;") == 2 and "<arXiv>" not in html
    assert not re.search(r"<(script|link[^>]*href=.http|img)", html)
    rows = made["groups"][0]["rows"]
    assert [row["rerun"]["equal"] for row in rows] == [True, True] and rows[1]["test"]["pairs"] == 3
    assert json.loads((tmp_path / "board" / "board.json").read_text())["title"] == "PushT"
