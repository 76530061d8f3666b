"""Published results, repeated: what is needed, and a table of ours and theirs as plain data."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm

GOLDEN = Path(__file__).resolve().parents[3] / "tests" / "golden" / "checkpoints" / "lewm_transformers4"

RECIPE = """
name = "lewm-small"
about = "a test"
env = "swm/PushT-v1"
image = 16

[checkpoint]
model = "lewm"
repository = "nobody-here/lewm-small"
revision = "main"
weights = "weights.pt"

[dataset]
name = "pusht.h5"
size = "2 kB"

[policy]
samples = 6
elites = 2
iterations = 1
horizon = 2
receding_horizon = 2

[[figure]]
name = "historic"
protocol = "rows of all episodes"
reported = 99.0
source = "a paper"

[figure.made]
tier = "historic"
episodes = 2
goal_offset = 4
budget = 4
seeds = [0, 1]
"""


@pytest.mark.skipif(_swm.HAS_TRAINING, reason="this build has trained models")
def test_a_build_without_models_names_the_wheel() -> None:
    for call in (swm.recipes, lambda: swm.reproduce("lewm-pusht", "out")):
        with pytest.raises(swm.SwmError, match="without the feature `baselines`, which every wheel has"):
            call()


@pytest.mark.skipif(not _swm.HAS_TRAINING, reason="this build has no trained models")
class TestReproduce:
    def test_recipes_are_plain_data(self) -> None:
        found = {recipe["name"]: recipe for recipe in swm.recipes()}
        assert list(found) == ["lewm-pusht", "lewm-cube", "lewm-reacher", "lewm-tworooms"]
        pusht = found["lewm-pusht"]
        assert pusht["env"] == "swm/PushT-v1" and pusht["checkpoint"]["repository"] == "quentinll/lewm-pusht"
        assert {figure["name"]: figure["reported"] for figure in pusht["figures"]} == {"moderate": 86.33, "strict": 70.33, "historic": 96.0}

    def test_what_must_be_downloaded_is_named(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path / "hub"))
        monkeypatch.setenv("STABLEWM_HOME", str(tmp_path))
        looked = swm.reproduce("lewm-pusht", figures="historic", check_only=True)
        assert [need["what"] for need in looked["needs"]] == ["checkpoint", "dataset"] and looked["rows"] == []
        assert all(need["found"] is None and need["fetch"][0] == "hf" for need in looked["needs"])
        with pytest.raises(swm.SwmError) as caught:
            swm.reproduce("lewm-pusht", tmp_path / "out", progress=False)
        message = str(caught.value)
        for part in (
            "checkpoint (72 MB): not in",
            "hf download quentinll/lewm-pusht config.json weights.pt --revision 22b330c28c27",
            "dataset (13.1 GB): not in",
            f"{tmp_path}/CLEAR-LeWM/manifests/v0.5/pusht/strict-seed42-n100.json",
            "fetch=True",
        ):
            assert part in message, message
        assert "--fetch" not in message and not (tmp_path / "out").exists()

    def test_wrong_arguments_are_named(self, tmp_path: Path) -> None:
        for options, match in (
            ({"name": "lewm-pushed"}, "is no recipe that this program has.*lewm-pusht"),
            ({"out": None}, r"a folder for the results must be named.*out.*check_only=True"),
            ({"figures": "strictest"}, "figures='?\"?strictest.*is no figure of lewm-pusht"),
            ({"pairs": 0}, "pairs=0: use 1 or more"),
        ):
            given: dict[str, Any] = {"name": "lewm-pusht", "out": tmp_path / "out", **options}
            with pytest.raises(swm.SwmError, match=match):
                swm.reproduce(**given)

    def test_a_result_is_a_table_of_plain_data(self, pusht_file: Path, tmp_path: Path) -> None:
        (tmp_path / "small.toml").write_text(RECIPE)
        shutil.copytree(GOLDEN, tmp_path / "lewm-small")
        assert pusht_file == tmp_path / "pusht.h5"
        options: dict[str, Any] = {"folder": tmp_path, "num_envs": 2, "threads": 1, "progress": False}
        done = swm.reproduce(str(tmp_path / "small.toml"), tmp_path / "out", **options)
        (row,) = done["rows"]
        low, high = row["ours"]["ci95"]
        assert row["figure"] == "historic" and row["reported"] == 99.0 and row["ours"]["episodes"] == 4
        assert low <= row["ours"]["success_rate"] <= high
        assert row["difference"] == pytest.approx(row["ours"]["success_rate"] - 99.0)
        assert row["is_within"] == (low <= 99.0 <= high)
        assert json.loads(Path(done["file"]).read_text())["rows"] == done["rows"]
        for repetition in row["repetitions"]:
            receipt = swm.read_receipt(repetition["receipt"])
            assert receipt["manifest_hash"] == repetition["manifest_hash"] and "samples=6" in receipt["policy"]
        # The same call does nothing again; the run is one like any other.
        assert swm.reproduce(tmp_path / "small.toml", tmp_path / "out", **options)["rows"] == done["rows"]
        assert (Path(done["run"]) / "config.json").is_file()
