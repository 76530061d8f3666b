"""Fixtures of the tests, and what they need of the machine.

Environments on MuJoCo need its library and models: in the wheel, or in the folder that ``SWM_HOME`` names. Tests that want
them take the fixture ``mujoco`` (``ogbench`` for its models) and are skipped where they are missing, unless
``SWM_TEST_ALL=1`` says that nothing may be.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm

ROOT = Path(__file__).resolve().parents[3]


def _missing(reason: str) -> None:
    if os.environ.get("SWM_TEST_ALL") == "1":
        pytest.fail(f"{reason}, and SWM_TEST_ALL=1 allows no skips")
    pytest.skip(reason)


@pytest.fixture(scope="session")
def mujoco() -> None:
    """Skips where MuJoCo's library or the control suite's models are missing."""
    library, folder, _ = _swm.files()
    if library is None or not library.is_file():
        _missing("MuJoCo's library is missing; run `cargo xtask setup`")
    if folder is None or not (folder / "dm_control").is_dir():
        _missing("the models of the control suite are missing; run `cargo xtask setup`")


@pytest.fixture(scope="session")
def ogbench(mujoco: None) -> None:
    """Skips where OGBench's models are missing."""
    _, folder, _ = _swm.files()
    if folder is None or not (folder / "ogbench").is_dir():
        _missing("the models of OGBench are missing; run `cargo xtask setup`")


@pytest.fixture(scope="session")
def command() -> str:
    """The built program ``swm`` of the same code; skips where there is none."""
    found = os.environ.get("SWM_COMMAND") or shutil.which("swm")
    if found is None:
        _missing("the program `swm` was not found; set SWM_COMMAND to target/debug/swm")
    assert found is not None
    return found


@pytest.fixture
def world() -> Any:
    """Makes a World of PushT, two environments on one thread unless asked for others; closes it after the test."""
    made: list[Any] = []

    def make(env_name: Any = "swm/PushT-v1", num_envs: int = 2, **options: Any) -> Any:
        options.setdefault("threads", 1)
        options.setdefault("image_shape", (32, 32))
        made.append(swm.World(env_name, num_envs, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def pusht_file(tmp_path: Path, world: Callable[..., Any]) -> Path:
    """A recording of PushT: four episodes of 20 steps by random actions, with images of 32 × 32."""
    path = tmp_path / "pusht.h5"
    recorder = world(max_episode_steps=20)
    recorder.set_policy("random")
    recorder.collect(path, episodes=4, seed=3, progress=False)
    return path


@pytest.fixture
def run_python() -> Callable[..., Any]:
    """Runs code in a Python of its own; gives the finished process."""
    import subprocess

    def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
        variables = {**os.environ, **environment}
        return subprocess.run([sys.executable, "-c", code], env=variables, capture_output=True, text=True, timeout=300)

    return run
