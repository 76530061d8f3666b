"""Export of torch models to ONNX."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from stable_worldmodel_rs.export import export_onnx  # noqa: E402

SIZES: dict[str, Any] = {"samples": 8, "horizon": 2, "dim": 4, "name": "point", "action_block": 2}
FIELDS = {"state": torch.zeros(1, 2), "goal_state": torch.zeros(1, 2)}


class Encode(torch.nn.Module):
    def forward(self, state: Any, goal_state: Any) -> dict[str, Any]:
        return {"start": state, "target": goal_state}


class Cost(torch.nn.Module):
    def forward(self, actions: Any, start: Any, target: Any) -> Any:
        moved = actions.unflatten(2, (-1, 2)).sum(dim=(1, 2))
        return (start + moved - target).square().sum(dim=1)


class CostOfAll(Cost):
    def forward(self, actions: Any, start: Any, target: Any) -> Any:
        return super().forward(actions, start, target).sum()


def test_missing_packages_are_named_before_a_folder_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stable_worldmodel_rs.export.find_spec", lambda name: None)
    with pytest.raises(ImportError, match="`pip install onnx onnxscript`"):
        export_onnx(tmp_path / "model", Encode(), Cost(), FIELDS, **SIZES)
    assert not (tmp_path / "model").exists()


def test_a_model_becomes_three_graphs_and_a_description(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxscript")
    export_onnx(tmp_path / "model", Encode(), Cost(), FIELDS, action_mean=[0, 1], action_std=[1, 2], **SIZES)
    described = json.loads((tmp_path / "model" / "model.json").read_text())
    scale = {"kind": "mean_std", "mean": [0.0, 1.0], "std": [1.0, 2.0]}
    assert described == {"name": "point", "action_block": 2, "action_scale": scale}
    outputs = {
        "encode": ["start", "target"],
        "cost": ["cost"],
        "cost_grad": ["cost", "gradient"],
    }
    for name, expected in outputs.items():
        graph = onnx.load(tmp_path / "model" / f"{name}.onnx").graph
        assert [output.name for output in graph.output] == expected


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dim": 3}, "dim 3 is not a multiple of action_block 2"),
        ({"action_mean": [0.0, 0.0]}, "give both, or neither"),
        ({"cost": CostOfAll()}, r"cost gave \(\) for 8 candidates"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    given = {"encode": Encode(), "cost": Cost(), "fields": FIELDS, **SIZES, **changes}
    with pytest.raises(ValueError, match=message):
        export_onnx(tmp_path / "model", **given)


def test_encode_must_name_its_tensors(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="a dict of tensors"):
        export_onnx(tmp_path / "model", torch.nn.Identity(), Cost(), {"input": torch.zeros(1, 2)}, **SIZES)
