"""The example that trains the reference's LeWM on our Loader and plans with our solver, for a few steps."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "lewm.py"


def test_lewm_learns_and_plans(tmp_path):
    pytest.importorskip("torch")
    imports = "from stable_worldmodel_rs import compat; compat.install(); import stable_worldmodel.wm.lewm"
    if subprocess.run([sys.executable, "-c", imports], capture_output=True, check=False).returncode != 0:
        pytest.skip("the reference, whose LeWM this is, is not installed with what it imports")
    sizes = "--episodes 4 --steps 30 --image 16 --batch 8 --dim 16 --samples 16 --eval 2 --budget 40 --device cpu"
    done = subprocess.run(
        [sys.executable, str(EXAMPLE), "--dataset", str(tmp_path / "lewm.h5"), *sizes.split()],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    first, last = (float(loss) for loss in done.stdout.splitlines()[0].removeprefix("loss ").split(" -> "))
    assert last < first
    assert "episodes: 2" in done.stdout and "ShootingCostEvaluator" in done.stdout
