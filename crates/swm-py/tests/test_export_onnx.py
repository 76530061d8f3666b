"""Export of torch models to ONNX."""

from __future__ import annotations

import json
import re
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


class Attention(Cost):
    """A cost with attention over the blocks of a plan: queries of `dims` dims, `[..., S, H, E]`."""

    def __init__(self, dims: int, masked: bool) -> None:
        super().__init__()
        self.dims, self.masked = dims, masked
        self.embed, self.read = torch.nn.Linear(4, 8), torch.nn.Linear(8, 4)

    def forward(self, actions: Any, start: Any, target: Any) -> Any:
        queries = self.embed(actions)
        queries = queries.flatten(0, 1) if self.dims == 2 else queries[(None,) * (self.dims - 3)]
        mask = torch.ones(2, 2).tril().bool() if self.masked and self.dims > 2 else None
        found = torch.nn.functional.scaled_dot_product_attention(queries, queries, queries, attn_mask=mask)
        return super().forward(actions + self.read(found.reshape(8, 2, 8)), start, target)


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


@pytest.mark.parametrize(("dims", "masked"), [(2, False), (3, False), (3, True), (4, True), (5, True)])
def test_attention_of_any_number_of_dims_gives_the_costs_of_torch(tmp_path: Path, dims: int, masked: bool) -> None:
    pytest.importorskip("onnxscript")
    onnxruntime = pytest.importorskip("onnxruntime")
    torch.manual_seed(0)
    cost = Attention(dims, masked)
    export_onnx(tmp_path / "model", Encode(), cost, FIELDS, **SIZES)
    actions, start, target = torch.randn(8, 2, 4), torch.randn(1, 2), torch.randn(1, 2)
    fed = {"actions": actions.numpy(), "start": start.numpy(), "target": target.numpy()}
    actions.requires_grad_()
    costs = cost(actions, start, target)
    (gradient,) = torch.autograd.grad(costs.sum(), actions)
    for file, expected in {"cost": [costs], "cost_grad": [costs, gradient]}.items():
        session = onnxruntime.InferenceSession(tmp_path / "model" / f"{file}.onnx")
        for found, wanted in zip(session.run(None, fed), expected, strict=True):
            torch.testing.assert_close(torch.as_tensor(found), wanted.detach(), rtol=1e-4, atol=1e-4)


def test_a_failed_export_leaves_everything_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("onnxscript")
    export, calls = torch.onnx.export, iter(range(100))

    def second_fails(*args: Any, **options: Any) -> Any:
        if next(calls) % 2:
            raise RuntimeError("no such operator")
        return export(*args, **options)

    monkeypatch.setattr(torch.onnx, "export", second_fails)
    old = tmp_path / "old"
    old.mkdir()
    (old / "encode.onnx").write_text("of before")
    for folder in (tmp_path / "deep" / "new", old):
        with pytest.raises(RuntimeError, match="no such operator"):
            export_onnx(folder, Encode(), Cost(), FIELDS, **SIZES)
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    assert [path.name for path in old.iterdir()] == ["encode.onnx"]
    assert (old / "encode.onnx").read_text() == "of before"


def test_an_export_replaces_an_earlier_one_whole(tmp_path: Path) -> None:
    pytest.importorskip("onnxscript")
    (tmp_path / "notes.txt").write_text("keep")
    for name in ("model.json", "cost_grad.onnx"):
        (tmp_path / name).write_text("of before")
    export_onnx(tmp_path, Encode(), Cost(), FIELDS, gradient=False, **SIZES)
    files = {"cost.onnx", "encode.onnx", "model.json", "notes.txt"}
    assert {path.name for path in tmp_path.iterdir()} == files
    with pytest.raises(NotADirectoryError, match="name a folder for the model"):
        export_onnx(tmp_path / "notes.txt", Encode(), Cost(), FIELDS, **SIZES)


def test_the_model_by_hand_of_the_page_loads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("onnx")
    onnxruntime = pytest.importorskip("onnxruntime")
    page = (Path(__file__).parents[3] / "docs" / "onnx.md").read_text()
    (script,) = [block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "by-hand" in block]
    monkeypatch.chdir(tmp_path)
    exec(script, {})  # noqa: S102  The page's own.
    for name in ("encode", "cost"):
        assert onnxruntime.InferenceSession(f"by-hand/{name}.onnx").get_outputs()
