"""The examples for submitit and Ray, on this machine."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import stable_worldmodel_rs as swm

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run(folder: Path, name: str, *options: str) -> str:
    home = str(Path(swm.__file__).resolve().parents[1])
    env = {**os.environ, "PYTHONPATH": home, "RAY_USAGE_STATS_ENABLED": "0", "RAY_ENABLE_UV_RUN_RUNTIME_ENV": "0"}
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *options], cwd=folder, env=env, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


@pytest.mark.skipif(find_spec("submitit") is None, reason="submitit is not installed")
def test_parts_by_submitit_are_one_result(tmp_path: Path) -> None:
    options = "--policy random --references no_op --parts 2 --cluster local --episodes 4 --budget 5".split()
    said = run(tmp_path, "submitit.py", *options)
    assert "part 2 of 2 is done" in said and "Receipt(swm/PushT-v1" in said
    whole = swm.evaluate(tmp_path / "task.toml", "random", references=["no_op"], progress=False)
    assert swm.same(whole, tmp_path / "result")


@pytest.mark.skipif(find_spec("ray") is None, reason="ray is not installed")
def test_ray_searches_settings(tmp_path: Path) -> None:
    options = "--samples 4 8 --seeds 0 1 --iterations 1 --episodes 2 --budget 4".split()
    said = run(tmp_path, "ray_tune.py", *options)
    assert "best: samples=" in said and "Comparison(" in said
    assert len(list((tmp_path / "tuned").glob("samples-*-seed-*/receipt.json"))) == 4
