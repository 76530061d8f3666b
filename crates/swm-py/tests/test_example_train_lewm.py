"""The example that trains LeWM: it learns, goes on after a stop with the same bits, and plans."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

import stable_worldmodel_rs as swm  # noqa: E402

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "train_lewm.py"
SMALL = "--size 32 --patch 8 --width 24 --depth 2 --episodes 6 --batch 16 --samples 16 --budget 40 --every 4 --device cpu"
# Ends behind the first save, as a job does whose time is over.
STOPS = """
import os, runpy, sys
replace = os.replace
def stop(*paths):
    replace(*paths)
    raise SystemExit(3)
os.replace = stop
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


def run(folder: Path, *command: str, steps: int = 12, eval: int = 0, code: int = 0, save: int = 1000) -> str:
    options = f"{SMALL} --steps {steps} --eval {eval} --save {save} --dataset tworoom.h5"
    # Processes of one training meet on this machine's own address.
    env = {**os.environ, "OMP_NUM_THREADS": "1", "GLOO_SOCKET_IFNAME": "lo", "PYTHONPATH": str(Path(swm.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, *command, *options.split()], capture_output=True, text=True, timeout=300, check=False, env=env, cwd=folder
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


def test_it_learns_goes_on_with_the_same_bits_and_plans(tmp_path: Path) -> None:
    said = run(tmp_path, str(EXAMPLE), "--out", "whole", eval=2)
    losses = [float(loss) for loss in re.findall(r"^step \d+: loss ([\d.]+) = ", said, re.MULTILINE)]
    assert len(losses) == 3 and losses[-1] < losses[0], said
    assert re.search(r"[\d.]+ steps/s, \d+ clips/s$", said, re.MULTILINE) and "episodes: 2" in said and "LeWM" in said
    metrics = swm.track.read(tmp_path / "whole")
    assert [line["step"] for line in metrics if line["part"] == "train"] == [4, 8, 12]
    assert metrics[0]["loss"] == pytest.approx(losses[0], abs=1e-4) and metrics[-1]["part"] == "evaluation" and metrics[-1]["episodes"] == 2
    # Stopped after 5 of 12 steps, in the midst of an epoch or behind one.
    run(tmp_path, "-c", STOPS, str(EXAMPLE), "--out", "parts", save=5, code=3)
    assert not (tmp_path / "parts" / "weights.pt").exists()
    assert "goes on from step 5" in run(tmp_path, str(EXAMPLE), "--out", "parts", save=5)
    whole, parts = (torch.load(tmp_path / name / "weights.pt", weights_only=True) for name in ("whole", "parts"))
    assert all(torch.equal(value, parts[name]) for name, value in whole.items())
    # Nothing is left to do: the model is as it was.
    assert "goes on from step 12" in run(tmp_path, str(EXAMPLE), "--out", "parts")
    assert isinstance(swm.load_pretrained(tmp_path / "parts"), swm.wm.LeWM)
    # Nor is a line of the metrics lost or written twice.
    parts = [line for line in swm.track.read(tmp_path / "parts") if line["part"] == "train"]
    assert [(line["step"], line["loss"]) for line in parts] == [(line["step"], line["loss"]) for line in metrics if line["part"] == "train"]
    # More steps are taken from there on.
    assert "step 14: loss" in run(tmp_path, str(EXAMPLE), "--out", "parts", steps=14)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the name of the loopback interface is Linux's")
def test_two_processes_train_one_model_each_on_its_part_of_the_clips(tmp_path: Path) -> None:
    run(tmp_path, str(EXAMPLE), "--out", "alone")
    for name in ("both", "again"):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        launcher = f"-m torch.distributed.run --nproc-per-node 2 --master-addr 127.0.0.1 --master-port {port}".split()
        assert "step 12: loss" in run(tmp_path, *launcher, str(EXAMPLE), "--out", name)
    alone, both, again = (torch.load(tmp_path / name / "weights.pt", weights_only=True) for name in ("alone", "both", "again"))
    assert all(torch.equal(value, again[name]) for name, value in both.items())
    assert any(not torch.equal(value, alone[name]) for name, value in both.items())
