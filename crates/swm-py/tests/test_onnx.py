"""Exported models are policies of the package: by name, with the history of frames that they ask for."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stable_worldmodel_rs as swm

SAMPLES = 200


def save(path: Path, nodes: list[Any], inputs: dict[str, list[int]], outputs: dict[str, list[int]], constants: list[Any]) -> None:
    """One graph; inputs and outputs: name -> shape, f32."""
    import onnx
    from onnx import TensorProto, helper

    values = [[helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in d.items()] for d in (inputs, outputs)]
    graph = helper.make_graph(nodes, path.stem, *values, initializer=constants)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10), path)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A model of TwoRoom with 3 frames of history: the cheapest action is 0.3 - last action / 2 + movement over two steps / 50."""
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    from onnx import TensorProto, helper

    folder = tmp_path / "model"
    folder.mkdir()
    history = {"state": [1, 3, 2], "action_history": [1, 2, 2]}
    encoded = {"states": [1, 3, 2], "blocks": [1, 2, 2]}
    node = helper.make_node
    save(
        folder / "encode.onnx",
        [node("Identity", [name], [to]) for name, to in zip(history, encoded, strict=True)],
        history,
        encoded,
        [],
    )
    number = {"oldest": 0, "one": 1, "newest": 2}
    indices = [helper.make_tensor(name, TensorProto.INT64, [], [value]) for name, value in number.items()]
    values = {"half": 0.5, "moved": 0.02, "base": 0.3}
    floats = [helper.make_tensor(name, TensorProto.FLOAT, [1], [value]) for name, value in values.items()]
    save(
        folder / "cost.onnx",
        [
            node("Gather", ["states", "newest"], ["now"], axis=1),
            node("Gather", ["states", "oldest"], ["then"], axis=1),
            node("Sub", ["now", "then"], ["movement"]),
            node("Mul", ["movement", "moved"], ["scaled"]),
            node("Gather", ["blocks", "one"], ["last"], axis=1),
            node("Mul", ["last", "half"], ["halved"]),
            node("Sub", ["scaled", "halved"], ["sum"]),
            node("Add", ["sum", "base"], ["wanted"]),
            node("Sub", ["actions", "wanted"], ["error"]),
            node("Mul", ["error", "error"], ["squared"]),
            node("ReduceSum", ["squared", "axes"], ["cost"], keepdims=0),
        ],
        {**encoded, "actions": [SAMPLES, 1, 2]},
        {"cost": [SAMPLES]},
        [*indices, *floats, helper.make_tensor("axes", TensorProto.INT64, [2], [1, 2])],
    )
    settings = {"name": "history", "action_block": 1, "history": 3, "history_fields": ["state"]}
    (folder / "model.json").write_text(json.dumps(settings))
    return folder


def policy(model: Path, **more: Any) -> swm.NativePolicy:
    settings = {"samples": SAMPLES, "iterations": 8, "elites": 20, "horizon": 1, "receding_horizon": 1}
    return swm.NativePolicy(f"onnx:{model}", **settings, **more)


def test_an_exported_model_sees_its_history(model: Path, world: Callable[..., Any]) -> None:
    rooms = world("swm/TwoRoom-v2", 2, add_pixels=False, image_shape=None)
    rooms.set_policy(policy(model))
    rooms.reset(seed=3)
    states, actions = [rooms.infos["state"][:, 0].copy()], [np.zeros((2, 2))]
    for step in range(5):
        rooms.step()
        action = rooms.infos["action"][:, 0].copy()
        # Younger episodes have copies of their first frame, and no action, in front.
        movement = states[-1] - states[max(step - 2, 0)]
        wanted = 0.3 - actions[-1] / 2 + movement / 50
        np.testing.assert_allclose(action, np.clip(wanted, -1, 1), atol=0.03)
        states.append(rooms.infos["state"][:, 0].copy())
        actions.append(action)
    assert np.abs(states[-1] - states[0]).max() > 1


def test_results_of_an_exported_model_have_receipts(model: Path, tmp_path: Path) -> None:
    manifest = tmp_path / "task.toml"
    swm.make_manifest(manifest, "swm/TwoRoom-v2", episodes=3, budget=6)
    one = swm.evaluate(manifest, policy(model), references=[], num_envs=1, progress=False)
    assert swm.same(one, swm.evaluate(manifest, policy(model), references=[], num_envs=3, progress=False))
    assert any(path.endswith("cost.onnx") or path.endswith("model") for path in one["files"]) and swm.verify(one, progress=False)["equal"]


def test_a_history_that_is_not_the_models_is_refused(model: Path, world: Callable[..., Any]) -> None:
    rooms = world("swm/TwoRoom-v2", 2, add_pixels=False, image_shape=None)
    with pytest.raises(swm.SwmError, match=r"the model sees 3 frame\(s\); set history_len=3"):
        rooms.set_policy(policy(model, history_len=2))
    path = model / "model.json"
    path.write_text(path.read_text().replace('"history": 3', '"history": 2'))
    rooms.set_policy(policy(model))
    with pytest.raises(swm.SwmError, match=r"the history is \[1, 2, …\] of 2 values a row, the model was exported for \[1, 3, 2\]"):
        rooms.evaluate(episodes=1, seed=0)
