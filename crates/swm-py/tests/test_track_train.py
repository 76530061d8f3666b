"""Trainings in trackers: lines of a run's metrics, followed while it grows; with the command, and from Python."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs.track._follow import Follower
from test_train import needs_training, rooms  # noqa: F401  a fixture

# A library that writes what it is told to a file.
FAKE = """
import json, os
class Run:
    def log(self, values, step=None): say("log", values, step)
    def finish(self): say("finish")
def say(*words):
    with open(os.environ["FAKE_TRACKIO"], "a") as file:
        file.write(json.dumps(words) + "\\n")
def init(**about):
    print("chatter")
    say("init", about)
    return Run()
"""


@pytest.fixture
def trackio(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Trackio in the form above, for other processes and this one; the file of what it was told."""
    packages, calls = tmp_path / "packages", tmp_path / "calls.jsonl"
    packages.mkdir()
    (packages / "trackio.py").write_text(FAKE)
    monkeypatch.syspath_prepend(str(packages))
    monkeypatch.delitem(sys.modules, "trackio", raising=False)
    paths = [str(packages), *(os.path.abspath(path) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path)]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    monkeypatch.setenv("FAKE_TRACKIO", str(calls))
    return calls


def told(calls: Path, what: str) -> list[Any]:
    found = [json.loads(line) for line in calls.read_text().splitlines()]
    return [line[1:] for line in found if line[0] == what]


def line(step: int, **values: float | None) -> str:
    return json.dumps({"step": step, "epoch": 0, "part": "train", "phase": "world", **values}) + "\n"


def begun(run: Path, last: int | None = None) -> Path:
    """A run's folder with its settings, and a checkpoint; gives its file of metrics."""
    (run / "checkpoints").mkdir(parents=True)
    (run / "config.json").write_text('{"fit": {"seed": 3}}')
    if last is not None:
        (run / "checkpoints" / f"step-{last:08}.json").write_text("{}")
        (run / "checkpoints" / f"step-{last:08}.training.safetensors").write_text("")
    return run / "metrics.jsonl"


def test_lines_are_handed_on_as_they_come(trackio: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    follower = Follower(run, ["trackio", "tensorboard"], project="p")
    follower.poll()
    file = begun(run)
    file.write_text("")
    follower.poll()
    assert not trackio.exists()
    with file.open("a") as out:
        out.write(line(1, loss=0.5) + line(2, loss=None)[:10])
        out.flush()
        follower.poll()
        assert told(trackio, "log") == [[{"train/epoch": 0.0, "train/loss": 0.5}, 1]]
        out.write(line(2, loss=None)[10:])
    follower.finish()
    ((values, step),) = told(trackio, "log")[1:]
    assert math.isnan(values["train/loss"]) and step == 2 and told(trackio, "finish") == [[]]
    assert told(trackio, "init") == [[{"project": "p", "name": "run", "config": {"fit.seed": 3}, "resume": "never"}]]


def test_a_run_that_goes_on_hands_on_new_lines_alone(trackio: Path, tmp_path: Path) -> None:
    file = begun(tmp_path / "run", last=2)
    # The killed program was at step 4; the training goes on from its checkpoint, and writes the file anew.
    file.write_text("".join(line(step, loss=1.0) for step in (1, 2, 3, 4)))
    follower = Follower(tmp_path / "run", ["trackio"])
    follower.poll()
    assert not trackio.exists()
    draft = file.with_name("draft")
    draft.write_text("".join(line(step, loss=1.0) for step in (1, 2)))
    os.replace(draft, file)
    with file.open("a") as out:
        out.write(line(3, loss=2.0))
    follower.finish()
    assert [step for _, step in told(trackio, "log")] == [3] and told(trackio, "init")[0][0]["resume"] == "allow"


def test_a_tracker_gets_what_a_training_writes(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with swm.track.start(None, tmp_path / "mine") as tracker:
        follower = Follower(run, tracker)
        begun(run).write_text(line(1, loss=0.5))
        follower.finish()
        with pytest.raises(ValueError, match="its folder is that of the run"):
            Follower(tmp_path / "mine", tracker)
    assert swm.track.read(tmp_path / "mine") == [{"step": 1, "part": "train", "epoch": 0.0, "loss": 0.5}]


def test_a_library_that_is_missing_is_told_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "wandb", None)
    (data := tmp_path / "a.h5").touch()
    with pytest.raises(ImportError, match="tracking by wandb needs the package wandb; `pip install wandb`"):
        swm.train("lewm", data, tmp_path / "run", tracker="wandb")
    with pytest.raises(ValueError, match="there is no tracker 'wandbi'"):
        swm.train("lewm", data, tmp_path / "run", tracker=["wandbi"])
    assert not (tmp_path / "run").exists()


def follow(run: Path, trackers: str, **variables: str) -> subprocess.Popen[str]:
    words = [sys.executable, "-m", "stable_worldmodel_rs.track", str(run), trackers, "--project", "p"]
    return subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ, **variables}
    )


def test_the_program_that_the_command_starts_follows_until_its_input_ends(trackio: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with follow(run, "trackio") as program:
        assert program.stdout is not None and program.stdin is not None
        assert program.stdout.readline() == "ready\n"
        begun(run).write_text(line(1, loss=0.5))
        program.stdin.close()
        # What libraries print does not get in the way.
        assert program.stdout.read() == "" and program.wait(timeout=60) == 0
    assert told(trackio, "log") == [[{"train/epoch": 0.0, "train/loss": 0.5}, 1]] and told(trackio, "finish") == [[]]


def test_the_program_says_what_is_missing_and_what_fails(trackio: Path, tmp_path: Path) -> None:
    with follow(tmp_path / "run", "trackio,wandbi") as program:
        said, _ = program.communicate(timeout=60)
    assert said.startswith("error there is no tracker 'wandbi'") and program.returncode == 1
    begun(tmp_path / "run")
    with follow(tmp_path / "run", "trackio", FAKE_TRACKIO=str(tmp_path / "none" / "calls")) as program:
        assert program.stdout is not None and program.stdin is not None
        assert program.stdout.readline() == "ready\n"
        (tmp_path / "run" / "metrics.jsonl").write_text(line(1, loss=0.5))
        program.stdin.close()
        assert program.stdout.read().startswith("error ") and program.wait(timeout=60) == 1


def command(*words: str | Path) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-m", "stable_worldmodel_rs", "train", *map(str, words)]
    return subprocess.run(program, capture_output=True, text=True, timeout=300)


@needs_training
def test_the_command_tracks_a_training(rooms: Path, trackio: Path, tmp_path: Path) -> None:  # noqa: F811
    run, small = tmp_path / "run", ["--preset", "small", "--batch", "4", "--log-every", "1"]
    done = command("lewm", "--dataset", rooms, "--out", run, *small, "--steps", "2", "--track", "trackio,tensorboard", "--track-project", "p")
    assert done.returncode == 0, done.stderr
    assert f"tensorboard --logdir {run}" in done.stderr and "tracking stopped" not in done.stderr
    assert [step for values, step in told(trackio, "log") if "train/loss" in values] == [1, 2]
    (about,) = told(trackio, "init")[0]
    assert about["project"] == "p" and about["config"]["fit.batch"] == 4 and len(told(trackio, "finish")) == 1
    done = command("--resume", run, "--steps", "3", "--track", "trackio")
    assert done.returncode == 0, done.stderr
    assert [step for values, step in told(trackio, "log") if "train/loss" in values] == [1, 2, 3]


@needs_training
def test_the_command_says_what_a_tracker_needs(rooms: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    packages = tmp_path / "packages"
    packages.mkdir()
    (packages / "wandb.py").write_text("raise ImportError('broken')\n")
    paths = [str(packages), *(os.path.abspath(path) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path)]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    run = tmp_path / "run"
    done = command("lewm", "--dataset", rooms, "--out", run, "--preset", "small", "--track", "wandb")
    assert done.returncode == 2 and "tracking by wandb needs the package wandb; `pip install wandb`" in done.stderr
    assert not run.exists()
    done = command("lewm", "--dataset", rooms, "--out", run, "--track", "wandbi")
    assert done.returncode == 2 and "trackio, wandb, mlflow, tensorboard" in done.stderr


@needs_training
def test_python_tracks_a_training(rooms: Path, trackio: Path, tmp_path: Path) -> None:  # noqa: F811
    swm.train("lewm", rooms, tmp_path / "run", preset="small", batch=4, steps=2, log_every=1, tracker="trackio", progress=False)
    assert [step for values, step in told(trackio, "log") if "train/loss" in values] == [1, 2]
    with swm.track.start(None, tmp_path / "mine") as tracker:
        swm.train(resume=tmp_path / "run", steps=3, tracker=tracker, progress=False)
    assert [one["step"] for one in swm.track.read(tmp_path / "mine") if one["part"] == "train"] == [3]
