"""What type checkers see: the stub is that of the compiled module, and programs are checked against real types."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import stable_worldmodel_rs as swm

pytest.importorskip("mypy", reason="mypy is not installed")

PROGRAM = """
import numpy as np
import stable_worldmodel_rs as swm

world = swm.World("swm/PushT-v1", num_envs=2, image_shape=(64, 64))
world.set_policy("expert")
result = world.evaluate(episodes=2, seed=0)
reveal_type(world)
reveal_type(result)
reveal_type(world.rewards)
dataset = swm.data.load_dataset("a.h5", num_steps=4)
reveal_type(swm.data.Loader(dataset, batch_size=8))
solver = swm.planning.CEMSolver(object(), num_samples=10)
config = swm.PlanConfig(horizon=5, receding_horizon=5)
reveal_type(swm.WorldModelPolicy(solver, config))
reveal_type(swm.evaluate("task.toml", "expert").success_rate)
try:
    world.reset(seed=1)
except swm.EnvError as error:
    reveal_type(error)
"""
SEEN = [
    "world.world.World",
    "world.results.EvaluationResult",
    "ndarray[",
    "data.loader.Loader",
    "policy.WorldModelPolicy",
    "float",
    "_swm.EnvError",
]


def run(*arguments: str, folder: Path) -> tuple[int, str]:
    env = dict(os.environ)
    home = Path(swm.__file__).parent.parent
    if home.name != "site-packages":
        # It is not installed, and mypy does not look at PYTHONPATH.
        env["MYPYPATH"] = env["PYTHONPATH"] = str(home)
    done = subprocess.run([sys.executable, "-m", *arguments], cwd=folder, env=env, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def test_the_stub_is_that_of_the_compiled_module(tmp_path: Path) -> None:
    # Of the rest of the package, only what the stub imports counts.
    config = tmp_path / "mypy.ini"
    config.write_text("[mypy]\nfollow_imports = silent\n")
    code, said = run("mypy.stubtest", "stable_worldmodel_rs._swm", "--mypy-config-file", str(config), folder=tmp_path)
    assert code == 0, said


def test_programs_are_checked_against_real_types(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    code, said = run("mypy", "--strict", "--follow-imports=silent", str(program), folder=tmp_path)
    assert code == 0, said
    revealed = [line for line in said.splitlines() if "Revealed type" in line]
    assert len(revealed) == len(SEEN), said
    for line, name in zip(revealed, SEEN):
        assert name in line, line


def test_wrong_programs_are_found(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text('import stable_worldmodel_rs as swm\nswm.World("swm/PushT-v1", number=2).evalute(1)\nswm.Wrold\n')
    code, said = run("mypy", "--strict", "--follow-imports=silent", str(program), folder=tmp_path)
    assert code == 1
    assert "evalute" in said and "Wrold" in said, said
