"""Runs that `swm export` wrote: torch loads them, and they compute what the checkpoints did that the runs were imported from."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from stable_worldmodel_rs import wm  # noqa: E402
from test_wm import GOLDEN, expected, joint_agrees, near, policy_agrees  # noqa: E402


def exported(command: str, tmp_path: Path, name: str, *options: str, transformers: int = 5) -> Path:
    run, out = tmp_path / "run", tmp_path / "out"

    def swm(*words: str | Path) -> None:
        done = subprocess.run([command, *map(str, words)], capture_output=True, text=True)
        if "without the feature `baselines`" in done.stderr:
            pytest.skip("this `swm` was built without the feature baselines")
        assert done.returncode == 0, done.stderr

    scale = ["--action-mean", "0,0", "--action-std", "1,1"]
    swm("import", GOLDEN / name, "--env", "swm/PushT-v1", *scale, *options, "--out", run)
    swm("export", run, "--transformers", str(transformers), "--out", out)
    return out


@pytest.mark.parametrize("transformers", [4, 5])
@pytest.mark.parametrize("name", ["lewm_transformers4", "pldm"])
def test_joint_models(command: str, tmp_path: Path, name: str, transformers: int) -> None:
    out = exported(command, tmp_path, name, transformers=transformers)
    state: dict[str, Any] = torch.load(out / "weights.pt", weights_only=True)
    assert ("encoder.layers.0.attention.q_proj.weight" in state) == (transformers == 5)
    counters = [value for tensor, value in state.items() if tensor.endswith("num_batches_tracked")]
    assert counters and all(value.dtype == torch.int64 and value.shape == () for value in counters)
    # Bits that memory maps need, and those that other programs unpickle.
    mapped: dict[str, Any] = torch.load(out / "weights.pt", weights_only=True, mmap=True)
    assert all(torch.equal(mapped[tensor], value) for tensor, value in state.items())
    joint_agrees(wm.load_pretrained(out), expected(name))


def test_prejepa(command: str, tmp_path: Path) -> None:
    scale = ["--proprio-mean", "0,0,0", "--proprio-std", "1,1,1"]
    out = exported(command, tmp_path, "prejepa", *scale)
    data = expected("prejepa")
    model = wm.load_pretrained(out)
    with torch.no_grad():
        seen = model.encode({"pixels": data["pixels"][:, None], "proprio": data["proprio"][:, None]}, emb_keys=["proprio"])
        near(seen["pixels_emb"][:, 0], data["tokens"])
        near(seen["emb"][:, 0], data["embeddings"])
    assert json.loads((out / "backbone" / "config.json").read_text())["num_attention_heads"] == 3


def test_policies(command: str, tmp_path: Path) -> None:
    out = exported(command, tmp_path, "gcbc")
    policy_agrees(wm.load_pretrained(out), expected("gcbc"))


def test_policies_with_a_value(command: str, tmp_path: Path) -> None:
    scale = ["--proprio-mean", "0,0,0", "--proprio-std", "1,1,1", "--as", "hilp", "--set", "model.encoder.heads=3"]
    out = exported(command, tmp_path, "hilp_policy", *scale)
    policy_agrees(wm.load_pretrained(out), expected("hilp_policy"))
