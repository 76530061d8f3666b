"""Training from Python, and what was trained as a policy; in builds that have training, as every wheel."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm

needs_training = pytest.mark.skipif(
    not _swm.HAS_TRAINING and os.environ.get("SWM_TEST_TRAINING") != "1", reason="this build has no training"
)


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """TwoRoom with images of 64 x 64: eight episodes by the expert."""
    path = tmp_path_factory.mktemp("rooms") / "rooms.h5"
    world = swm.World("swm/TwoRoom-v2", num_envs=4, image_shape=(64, 64), max_episode_steps=40, threads=1)
    world.set_policy("expert")
    world.collect(path, episodes=8, seed=0, progress=False)
    world.close()
    return path


@needs_training
def test_a_run_needs_a_folder(rooms: Path) -> None:
    with pytest.raises(swm.SwmError, match="out: name the folder of the new run; give resume to continue one"):
        swm.train("lewm", rooms)


@pytest.mark.skipif(_swm.HAS_TRAINING, reason="this build has training")
def test_a_build_without_training_says_so(tmp_path: Path) -> None:
    (data := tmp_path / "rooms.h5").touch()
    with pytest.raises(swm.SwmError, match="built without the feature `baselines`"):
        swm.train("lewm", data, tmp_path / "run")


@needs_training
def test_a_world_model_is_trained_resumed_and_planned_with(rooms: Path, tmp_path: Path) -> None:
    run = tmp_path / "lewm"
    state = swm.train("lewm", rooms, run, preset="small", steps=2, batch=4, settings={"optim": {"lr": 1e-3}}, progress=False)
    assert state["run"] == str(run) and state["step"] == 2 and state["end"] == "complete" and state["train"]["loss"] > 0
    config = json.loads((run / "config.json").read_text())
    assert config["fit"]["batch"] == 4 and config["model_config"]["settings"]["optim"]["lr"] == 0.001
    assert swm.train(resume=run, steps=3, progress=False)["step"] == 3
    assert [line["step"] for line in swm.track.read(run)][-1] == 3
    world = swm.World("swm/TwoRoom-v2", num_envs=2, image_shape=(64, 64), max_episode_steps=6, threads=1)
    world.set_policy(f"mpc:{run},samples=8,iterations=1,elites=2")
    assert world.evaluate(episodes=2, seed=0)["episodes"] == 2
    world.close()


@needs_training
def test_a_policy_is_trained_and_acts_on_a_manifest(rooms: Path, tmp_path: Path) -> None:
    run = tmp_path / "gcbc"
    swm.train("gcbc", rooms, run, preset="small", steps=2, batch=4, seed=1, progress=False)
    manifest = swm.make_manifest(tmp_path / "task.toml", "swm/TwoRoom-v2", episodes=2, budget=4, image_shape=(64, 64))
    receipt = swm.evaluate(manifest, f"gcbc:{run}", references=["random"], progress=False)
    assert receipt["policy"].startswith("gcbc:step=2,weights=") and len(receipt["files"]) == 2


@needs_training
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("lewn",), ["unknown baseline or agent `lewn`", "lewm"]),
        (("lewm", "none.h5"), ["none.h5"]),
        (("lewm", "ROOMS", "batch=0"), ["batch=0: a step learns from 1 clip or more"]),
        (("lewm", "ROOMS", "settings"), ["lrr"]),
        (("sac",), ['give env="swm/CartpoleDMControl-v0"']),
    ],
)
def test_wrong_requests_are_told(rooms: Path, tmp_path: Path, arguments: tuple[str, ...], words: list[str]) -> None:
    more: dict[str, Any] = {"batch": 0} if "batch=0" in arguments else {}
    if "settings" in arguments:
        more["settings"] = {"optim.lrr": 1}
    dataset = None if len(arguments) == 1 else rooms if arguments[1] == "ROOMS" else arguments[1]
    with pytest.raises((swm.SwmError, FileNotFoundError)) as caught:
        swm.train(arguments[0], dataset, tmp_path / "run", preset="small", progress=False, **more)
    said = str(caught.value)
    assert not [word for word in words if word not in said] and "Usage" not in said, said
    assert not (tmp_path / "run" / "config.json").exists()


@needs_training
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_an_interrupted_training_leaves_a_checkpoint(rooms: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    code = f"""
import signal
import stable_worldmodel_rs as swm
signal.signal(signal.SIGINT, signal.default_int_handler)  # A shell's background ignores it.
try:
    swm.train("pldm", {str(rooms)!r}, {str(run)!r}, preset="small", steps=100000, batch=2, log_every=1, progress=False)
except KeyboardInterrupt:
    print("stopped", flush=True)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as program:
        end = time.monotonic() + 120
        while not (run / "checkpoints").is_dir() and time.monotonic() < end:
            time.sleep(0.1)
        time.sleep(1.0)
        program.send_signal(signal.SIGINT)
        said, _ = program.communicate(timeout=60)
    assert said.strip() == "stopped" and list((run / "checkpoints").glob("step-*.json"))


@needs_training
def test_the_command_of_the_package_trains() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "stable_worldmodel_rs", "--json", "train", "--list"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert {"lewm", "gcsl", "keypoint-wm", "sac"} <= {one["name"] for one in json.loads(done.stdout)}
