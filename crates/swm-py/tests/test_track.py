"""Tracking: one file of metrics, and what each tracker's library is told; with the libraries themselves where they are installed."""

from __future__ import annotations

import json
import math
import struct
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import stable_worldmodel_rs as swm

NAN, INF = float("nan"), float("inf")


class Calls:
    """Takes any call of a library, and remembers it."""

    def __init__(self, log: list[tuple[str, tuple[Any, ...], dict[str, Any]]], path: str = "", **known: Any) -> None:
        self._log, self._path, self._known = log, path, known

    def __getattr__(self, name: str) -> Any:
        if name in self._known:
            return self._known[name]
        return Calls(self._log, f"{self._path}.{name}".lstrip("."), **self._known)

    def __call__(self, *args: Any, **named: Any) -> Any:
        self._log.append((self._path, args, named))
        return Calls(self._log, self._path, **self._known)


def stub(monkeypatch: pytest.MonkeyPatch, name: str, **known: Any) -> list[tuple[str, tuple[Any, ...], dict[str, Any]]]:
    """A module that remembers its calls in the place of a library."""
    log: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
    parts = name.split(".")
    for end in range(1, len(parts) + 1):
        module = ModuleType(".".join(parts[:end]))
        module.__path__ = []  # type: ignore[attr-defined]
        calls = Calls(log, **known)
        module.__getattr__ = lambda attribute, calls=calls: getattr(calls, attribute)  # type: ignore[method-assign, misc]
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return log


def named(log: list[tuple[str, tuple[Any, ...], dict[str, Any]]], name: str) -> list[tuple[tuple[Any, ...], dict[str, Any]]]:
    return [(args, kwargs) for path, args, kwargs in log if path == name]


def receipt(tmp_path: Path, **more: Any) -> Any:
    swm.make_manifest(tmp_path / "task.toml", "swm/PushT-v1", episodes=2, budget=4)
    return swm.evaluate(tmp_path / "task.toml", "random", references=["no_op"], progress=False, **more)


def test_the_file_has_a_line_per_record_and_goes_on(tmp_path: Path) -> None:
    with swm.track.start(None, tmp_path / "run", config={"lr": 0.1}) as tracker:
        tracker.log({"loss": np.float32(0.5), "best": np.array(2), "done": True}, step=1)
        tracker.log({"loss": NAN, "worst": -INF})
        tracker.log({"loss": 0.25}, step=3, part="validation")
    lines = swm.track.read(tmp_path / "run")
    assert lines[0] == {"step": 1, "part": "train", "loss": 0.5, "best": 2.0, "done": 1.0}
    assert lines[1] == {"step": 2, "part": "train", "loss": None, "worst": None} and lines[2]["part"] == "validation"
    file = tmp_path / "run" / "metrics.jsonl"
    # A kill cuts the last line off; a training goes on from an earlier step.
    file.write_text(file.read_text() + '{"step": 4, "lo')
    swm.track.start(None, tmp_path / "run", after=2).log({"loss": 1.0}, step=3)
    assert [line["step"] for line in swm.track.read(file)] == [1, 2, 3]
    file.write_text("no json\n" + file.read_text())
    with pytest.raises(ValueError, match="line 1 is no JSON"):
        swm.track.read(file)


def test_wrong_values_and_names_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tracker = swm.track.start(None, tmp_path / "run")
    result: dict[str, Any] = {"success_rate": 1.0, "interval": (0.0, 2.0), "episodes": 1}
    for call in (lambda step: tracker.log({"loss": 1.0}, step), lambda step: tracker.evaluation(result, step=step)):
        with pytest.raises(ValueError, match="step=-1: give 0 or more"):
            call(-1)
        with pytest.raises(TypeError, match=r"step=2\.5: give a whole number"):
            call(2.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="after=-1: give 0 or more"):
        swm.track.start(None, tmp_path / "other", after=-1)
    assert not (tmp_path / "run" / "metrics.jsonl").exists() and not (tmp_path / "other").exists()
    with pytest.raises(TypeError, match=r"losses: more than one number"):
        tracker.log({"losses": np.zeros(3)})
    with pytest.raises(TypeError, match=r"name: str is no number; settings go into config="):
        tracker.log({"name": "lewm"})
    with pytest.raises(ValueError, match="there is no tracker 'wandbi'; use trackio, wandb, mlflow, tensorboard"):
        swm.track.start("wandbi", tmp_path / "run")
    with pytest.raises(FileNotFoundError, match=r"none/metrics\.jsonl|there is no .*none"):
        swm.track.read(tmp_path / "none")
    for name in swm.track.TRACKERS:
        monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(ImportError, match=rf"tracking by {name} needs the package {name}; `pip install {name}`"):
            swm.track.start(name, tmp_path / name)
        assert not (tmp_path / name / "metrics.jsonl").exists()


def test_importing_the_module_imports_no_library(run_python: Any) -> None:
    done = run_python(
        "import sys, stable_worldmodel_rs as swm; swm.track.start; print(sorted({'trackio', 'wandb', 'mlflow', 'tensorboard'} & set(sys.modules)))"
    )
    assert done.stdout.strip() == "[]", done.stderr


def test_trackio_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = stub(monkeypatch, "trackio")
    with swm.track.start("trackio", tmp_path / "run", project="p", config={"a": {"b": 1}, "c": [1, 2]}) as tracker:
        tracker.log({"loss": NAN}, step=7)
    assert named(log, "init") == [((), {"project": "p", "name": "run", "config": {"a.b": 1, "c": "[1, 2]"}, "resume": "never"})]
    (values,), step = named(log, "init.log")[0]
    assert math.isnan(values["train/loss"]) and step == {"step": 7} and len(named(log, "init.finish")) == 1


def test_wandb_is_offline_and_goes_on_with_its_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WANDB_MODE", raising=False)
    log = stub(monkeypatch, "wandb", id="r1")
    swm.track.start("wandb", tmp_path / "run").finish()
    swm.track.start("wandb", tmp_path / "run", after=3).finish()
    swm.track.start("wandb", tmp_path / "run").finish()
    first, second, third = (kwargs for _, kwargs in named(log, "init"))
    assert first["mode"] == "offline" and first["dir"] == str(tmp_path / "run") and "id" not in first
    assert second["id"] == "r1" and second["resume"] == "allow" and "id" not in third
    monkeypatch.setenv("WANDB_MODE", "online")
    swm.track.start("wandb", tmp_path / "run").finish()
    assert named(log, "init")[-1][1]["mode"] == "online"


def test_mlflow_gets_names_that_it_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    log = stub(monkeypatch, "mlflow", run_id="m1", experiment_id="e")
    with swm.track.start("mlflow", tmp_path / "run", config={"long": "x" * 900}) as tracker:
        tracker.log({"agent.color=red": 1.0}, step=2)
    assert named(log, "MlflowClient")[0][1]["tracking_uri"] == f"sqlite:///{(tmp_path / 'run').resolve() / 'mlflow.db'}"
    assert named(log, "MlflowClient.log_param")[0][0] == ("m1", "long", "x" * 500)
    assert named(log, "MlflowClient.log_metric") == [(("m1", "train/agent.color_red", 1.0), {"step": 2})]
    swm.track.start("mlflow", tmp_path / "run", after=2).finish()
    assert len(named(log, "MlflowClient.create_run")) == 1 and len(named(log, "MlflowClient.update_run")) == 1
    assert named(log, "MlflowClient.set_terminated")[-1][0] == ("m1",)


def test_tensorboard_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = stub(monkeypatch, "tensorboard.summary")
    with swm.track.start(["tensorboard"], tmp_path / "run") as tracker:
        tracker.log({"loss": 0.5}, step=2)
    assert named(log, "Writer") == [((str(tmp_path / "run" / "tensorboard"),), {})]
    assert named(log, "Writer.add_scalar") == [(("train/loss", 0.5, 2), {})] and len(named(log, "Writer.close")) == 1


def test_evaluations_log_success_with_interval_and_the_receipt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, world: Any) -> None:
    log = stub(monkeypatch, "trackio")
    with swm.track.start("trackio", tmp_path / "run") as tracker:
        tracker.log({"loss": 1.0}, step=5)
        result = receipt(tmp_path, tracker=tracker)
        one = world(max_episode_steps=4)
        one.set_policy("random")
        one.evaluate(episodes=2, seed=1, tracker=tracker)
    (values,), step = named(log, "init.log")[1]
    low, high = result.interval
    assert step == {"step": 5} and values["evaluation/success_rate"] == result.success_rate
    assert (values["evaluation/success_low"], values["evaluation/success_high"]) == (low, high)
    assert "evaluation/no_op/success_rate" in values
    document = tmp_path / "run" / "evaluations" / "evaluation-5.json"
    assert named(log, "Artifact.add_file")[0][0] == (str(document),)
    assert "episode_successes" in json.loads(document.with_name("evaluation-5-2.json").read_text())
    assert [line["part"] for line in swm.track.read(tmp_path / "run")] == ["train", "evaluation", "evaluation"]
    # By name, into the folder of the result.
    receipt(tmp_path, tracker="trackio", out=tmp_path / "result")
    assert swm.track.read(tmp_path / "result")[0]["success_rate"] == result.success_rate
    assert len(named(log, "init.finish")) == 2
    with pytest.raises(ValueError, match="give it with join=True"):
        swm.evaluate(tmp_path / "task.toml", "random", tmp_path / "parts", shard=(1, 2), tracker="trackio")  # type: ignore[call-overload]


def test_metrics_of_the_command_are_sent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = stub(monkeypatch, "trackio")
    (tmp_path / "config.json").write_text('{"fit": {"seed": 3}}')
    line = {"step": 10, "epoch": 0, "part": "train", "phase": "world", "loss": None, "clips_per_s": 3.5}
    (tmp_path / "metrics.jsonl").write_text(json.dumps(line) + "\n")
    assert swm.track.send(tmp_path, "trackio", name="run") == 1
    assert named(log, "init")[0][1]["config"] == {"fit.seed": 3}
    (values,), step = named(log, "init.log")[0]
    assert math.isnan(values["train/loss"]) and values["train/clips_per_s"] == 3.5 and "train/phase" not in values and step == {"step": 10}


@pytest.mark.skipif(find_spec("trackio") is None, reason="trackio is not installed")
def test_trackio_reads_its_run_back(tmp_path: Path, run_python: Any) -> None:
    code = f"""
import json, math, stable_worldmodel_rs as swm
with swm.track.start("trackio", {str(tmp_path / "run")!r}, project="p") as tracker:
    tracker.log({{"loss": float("nan"), "best": float("inf")}}, step=3)
from trackio.sqlite_storage import SQLiteStorage
found = SQLiteStorage.get_logs("p", "run")
assert math.isnan(found[0]["train/loss"]) and found[0]["train/best"] == math.inf and found[0]["step"] == 3, found
"""
    done = run_python(code, TRACKIO_DIR=str(tmp_path / "trackio"))
    assert done.returncode == 0, done.stderr


def wandb_records(path: Path) -> list[Any]:
    """Records of an offline run: a log of blocks of 32 KiB, whose pieces have a header of 7 bytes."""
    from wandb.proto import wandb_internal_pb2  # type: ignore[import-not-found]

    data, at, whole, found = path.read_bytes(), 7, b"", []
    while at + 7 <= len(data):
        left = 32768 - at % 32768
        if left < 7:
            at += left
            continue
        _, length, kind = struct.unpack("<IHB", data[at : at + 7])
        whole += data[at + 7 : at + 7 + length]
        at += 7 + length
        if kind in (1, 4):
            record = wandb_internal_pb2.Record()
            record.ParseFromString(whole)
            found.append(record)
            whole = b""
    return found


@pytest.mark.skipif(find_spec("wandb") is None, reason="wandb is not installed")
def test_wandb_reads_its_run_back(tmp_path: Path) -> None:
    with swm.track.start("wandb", tmp_path / "run", project="p") as tracker:
        tracker.log({"loss": NAN}, step=3)
        tracker.evaluation(receipt(tmp_path))
    (file,) = (tmp_path / "run" / "wandb").glob("offline-run-*/*.wandb")
    history = [record.history for record in wandb_records(file) if record.WhichOneof("record_type") == "history"]
    items = {item.key or "/".join(item.nested_key): json.loads(item.value_json) for one in history for item in one.item}
    assert math.isnan(items["train/loss"]) and items["_step"] == 3 and "evaluation/success_rate" in items, items


@pytest.mark.skipif(find_spec("mlflow") is None or find_spec("sqlalchemy") is None, reason="mlflow is not installed")
def test_mlflow_reads_its_run_back(tmp_path: Path) -> None:
    from mlflow import MlflowClient  # type: ignore[import-not-found]

    with swm.track.start("mlflow", tmp_path / "run", project="p", config={"lr": 0.1}) as tracker:
        tracker.log({"loss": NAN}, step=3)
        tracker.evaluation(receipt(tmp_path))
    client = MlflowClient(tracking_uri=f"sqlite:///{tmp_path / 'run' / 'mlflow.db'}")
    (run,) = client.search_runs([client.get_experiment_by_name("p").experiment_id])
    (point,) = client.get_metric_history(run.info.run_id, "train/loss")
    assert math.isnan(point.value) and point.step == 3 and run.data.params["lr"] == "0.1" and run.info.status == "FINISHED"
    assert client.list_artifacts(run.info.run_id, "evaluation")[0].path == "evaluation/evaluation-3.json"


@pytest.mark.skipif(find_spec("tensorboard") is None, reason="tensorboard is not installed")
def test_tensorboard_reads_its_run_back(tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator  # type: ignore[import-not-found]
    from tensorboard.util.tensor_util import make_ndarray  # type: ignore[import-not-found]

    with swm.track.start("tensorboard", tmp_path / "run") as tracker:
        tracker.log({"loss": NAN, "best": 2.0}, step=3)
    events = EventAccumulator(str(tmp_path / "run" / "tensorboard"))
    events.Reload()
    assert math.isnan(make_ndarray(events.Tensors("train/loss")[0].tensor_proto))
    (point,) = events.Tensors("train/best")
    assert point.step == 3 and make_ndarray(point.tensor_proto) == 2.0
