"""The zoo: a trained model that is shipped, by name; found, listed, used as a policy, run again, bundled."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm
from test_train import needs_training, rooms  # noqa: F401  a fixture

ROOT = Path(__file__).resolve().parents[3]
NAME = "tworoom-gcbc"
RECIPE = """about = "a model of tests"
license = "MIT OR Apache-2.0"
steps = ["train gcbc --dataset data.h5 --out run", "eval --manifest task.toml --policy gcbc:run --out result"]
result = "result"
"""


@pytest.fixture(scope="module")
def made(rooms: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: F811
    """A folder with one model, as `cargo xtask zoo` makes it: a policy that was trained for a moment, or, without training, `random`."""
    work = tmp_path_factory.mktemp("made")
    policy = "random"
    if _swm.HAS_TRAINING:
        swm.train("gcbc", rooms, work / "run", preset="small", steps=2, batch=4, keep=1, progress=False)
        policy = f"gcbc:{work / 'run'}"
    task = swm.make_manifest(work / "task.toml", "swm/TwoRoom-v2", episodes=4, budget=6, image_shape=(64, 64))
    swm.evaluate(task, policy, work / "result", references=["no_op"], progress=False)
    model = work / "zoo" / NAME
    model.parent.mkdir()
    swm.bundle(work / "result", model, license="MIT OR Apache-2.0")
    (model / "recipe.toml").write_text(RECIPE)
    with (model / "SHA256SUMS").open("a") as sums:
        sums.write(f"{hashlib.sha256(RECIPE.encode()).hexdigest()}  recipe.toml\n")
    return work / "zoo"


@pytest.fixture
def zoo(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it that may be changed, where models are looked for."""
    folder = tmp_path / "zoo"
    shutil.copytree(made, folder)
    monkeypatch.setenv("SWM_ZOO", str(folder))
    return folder


def run(*words: str | Path, **variables: str) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-m", "stable_worldmodel_rs", *map(str, words)]
    return subprocess.run(program, capture_output=True, text=True, timeout=300, env={**os.environ, **variables})


def test_a_model_is_loaded_with_what_is_known_of_it(zoo: Path) -> None:
    model = swm.zoo.load(NAME)
    low, high = model.about["ci95"]
    assert model.text == f"zoo:{NAME}" and model.env == "swm_rs/TwoRoom-v2" and model.folder == zoo / NAME
    assert low <= model.about["success_rate"] == model.receipt.success_rate <= high
    assert model.about["license"] == "MIT OR Apache-2.0" and model.about["steps"][-1].startswith("eval ")
    assert not _swm.HAS_TRAINING or "MIT OR Apache-2.0" in model.card
    assert swm.zoo.load(f"zoo:{NAME}", transfer=True).text == f"zoo:{NAME},transfer=true" and NAME in repr(model)
    assert [one["name"] for one in swm.zoo.list_models()] == [NAME]
    # The paths of the machine that made it are not in the receipt.
    text = (zoo / NAME / "receipt.json").read_text()
    assert not _swm.HAS_TRAINING or json.loads(text)["candidate"]["policy"]["positional"] == ["model"]
    assert "/made" not in text and model.receipt["summary"]["success_rate"] == model.about["success_rate"]


def test_unknown_names_are_told_with_the_nearest(zoo: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(swm.SwmError, match=r"there is no model zoo:tworoom-gcb \(did you mean `tworoom-gcbc`\?\); the zoo has: tworoom-gcbc"):
        swm.zoo.load("tworoom-gcb")
    monkeypatch.setenv("SWM_ZOO", str(tmp_path / "none"))
    with pytest.raises(swm.SwmError, match="no model of the zoo is installed: `pip install stable_worldmodel_zoo-"):
        swm.zoo.load(NAME)
    assert swm.zoo.list_models() == []


def test_a_model_with_a_changed_byte_is_refused(zoo: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = next((zoo / NAME / "model" / "checkpoints").glob("*.safetensors"), zoo / NAME / "manifest.json")
    data = bytearray(file.read_bytes())
    data[-1] ^= 1
    file.write_bytes(data)
    with pytest.raises(swm.SwmError, match=rf"{file.relative_to(zoo / NAME).as_posix()} was changed"):
        swm.zoo.load(NAME)
    assert swm.zoo.list_models() == [] and "is left out" in caplog.text


def test_the_package_of_the_zoo_is_found_and_not_imported(made: Path, tmp_path: Path) -> None:
    package = tmp_path / "stable_worldmodel_zoo"
    shutil.copytree(ROOT / "zoo" / "stable_worldmodel_zoo", package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(made, package / "models")
    code = "import sys, stable_worldmodel_rs as swm; print(swm.zoo.load('tworoom-gcbc').folder, 'stable_worldmodel_zoo' in sys.modules)"
    paths = [str(tmp_path), *(os.path.abspath(path) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path)]
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    variables.pop("SWM_ZOO", None)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=variables, timeout=60)
    assert done.stdout.split() == [str(package / "models" / NAME), "False"], done.stderr


def test_the_command_lists_and_shows(zoo: Path, tmp_path: Path) -> None:
    listed = run("zoo")
    assert listed.returncode == 0 and f"zoo:{NAME}" in listed.stdout and "MIT OR Apache-2.0" in listed.stdout
    shown = run("zoo", NAME)
    assert "made by" in shown.stdout and "swm-rs train gcbc" in shown.stdout, shown.stdout + shown.stderr
    assert run("zoo", NAME, "--path").stdout.strip() == str(zoo / NAME)
    wrong = run("zoo", "tworoom-gcb")
    assert wrong.returncode == 2 and "did you mean `tworoom-gcbc`?" in wrong.stderr
    nothing = run("zoo", SWM_ZOO=str(tmp_path / "none"))
    assert nothing.returncode == 0 and "pip install stable_worldmodel_zoo-" in nothing.stderr


@needs_training
def test_a_model_acts_and_its_result_is_that_of_its_receipt(zoo: Path) -> None:
    model = swm.zoo.load(NAME)
    world = swm.World(model.env, num_envs=4, image_shape=(64, 64), max_episode_steps=10, threads=1)
    world.set_policy(model)
    assert world.evaluate(episodes=4, seed=0)["episodes"] == 4
    assert swm.verify(model.folder, progress=False)["equal"]


@needs_training
def test_a_result_of_the_zoo_is_bundled_with_the_model(zoo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    task = swm.make_manifest(tmp_path / "task.toml", "swm/TwoRoom-v2", episodes=2, budget=6, image_shape=(64, 64))
    results: list[Any] = []
    for number, policy in enumerate([f"zoo:{NAME}", f"policy:zoo:{NAME}"]):
        out = tmp_path / f"result-{number}"
        results.append(swm.evaluate(task, policy, out, references=["random"], progress=False))
        swm.bundle(out, tmp_path / f"bundle-{number}", license="MIT")
    assert results[0]["episodes"] == results[1]["episodes"] and results[0]["policy"] == results[1]["policy"]
    monkeypatch.setenv("SWM_ZOO", str(tmp_path / "none"))
    for number, name in enumerate(["gcbc", "policy"]):
        text = (tmp_path / f"bundle-{number}" / "receipt.json").read_text()
        assert str(tmp_path) not in text and json.loads(text)["candidate"]["policy"] == {"name": name, "positional": ["model"]}
        assert swm.verify(tmp_path / f"bundle-{number}", progress=False)["equal"]


@needs_training
def test_policies_by_unknown_names_are_refused(zoo: Path) -> None:
    world = swm.World("swm/TwoRoom-v2", num_envs=1, image_shape=(64, 64), threads=1)
    for policy, words in [("zoo:tworom-gcbc", "did you mean `tworoom-gcbc`"), ("zoo", "name one model of the zoo"), ("mpc:zoo:x", "zoo:x")]:
        with pytest.raises(swm.SwmError, match=words):
            world.set_policy(policy)
    with pytest.raises(swm.SwmError, match="does not act by itself|is no world model|plans|acts"):
        world.set_policy(f"mpc:zoo:{NAME}")


def test_without_training_the_policy_says_what_it_needs(zoo: Path) -> None:
    if _swm.HAS_TRAINING:
        pytest.skip("this build has training")
    world = swm.World("swm/TwoRoom-v2", num_envs=1, image_shape=(64, 64), threads=1)
    with pytest.raises(swm.SwmError, match="built without the feature `baselines`"):
        world.set_policy(f"zoo:{NAME}")
