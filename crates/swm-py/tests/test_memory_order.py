"""Arrays are values, however they lie in memory: transposed, reversed, strided, of torch. Elsewhere, such arrays have been written
as they lie: see docs/traps.md on safetensors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm

LAYOUTS: list[Callable[[Any], Any]] = [
    np.asfortranarray,
    lambda values: np.ascontiguousarray(values[::-1])[::-1],
    lambda values: np.repeat(values, 2, axis=0)[::2],
    lambda values: np.ascontiguousarray(np.moveaxis(values, 0, -1)).transpose(-1, *range(values.ndim - 1)),
]


def laid_out(values: Any, layout: Callable[[Any], Any]) -> Any:
    other = layout(values)
    assert (other == values).all() and (values.shape == other.shape)
    return other


@pytest.mark.parametrize("layout", LAYOUTS)
def test_actions_are_taken_by_value(world: Callable[..., Any], layout: Callable[[Any], Any]) -> None:
    actions = np.random.default_rng(0).uniform(-1, 1, (3, 2)).astype(np.float32)
    seen = []
    for given in (actions, laid_out(actions, layout), actions.astype(np.float64).T.copy().T):
        live = world(num_envs=3)
        live.reset(seed=0)
        live.step(given)
        seen.append(live.infos["state"].copy())
    assert (seen[0] == seen[1]).all() and (seen[0] == seen[2]).all()


@pytest.mark.parametrize("shape", [(2, 3), (6,), (1, 6), (3, 2, 1, 2)])
def test_actions_of_another_shape_are_refused(world: Callable[..., Any], shape: tuple[int, ...]) -> None:
    live = world(num_envs=3)
    live.reset(seed=0)
    for dtype in (np.float32, np.float64):
        with pytest.raises(swm.SwmError, match=r"actions must be numbers of shape \[3, 2\], one row per environment, found float"):
            live.step(np.zeros(shape, dtype))
    live.step(np.zeros((3, 1, 2), np.float32))


@pytest.mark.parametrize("format", ["hdf5", "mcap", "folder"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_datasets_hold_values(tmp_path: Path, format: str, layout: Callable[[Any], Any]) -> None:
    rng = np.random.default_rng(0)
    state = rng.standard_normal((5, 3)).astype(np.float32)
    grid = rng.integers(0, 9, (5, 2, 4))
    with swm.data.get_format(format).open_writer(tmp_path / "data") as writer:
        writer.write_episode({"state": laid_out(state, layout), "grid": laid_out(grid, layout), "action": state[:, :2].T.copy().T})
    dataset: Any = swm.data.get_format(format).open_reader(tmp_path / "data")
    assert (dataset.get_col_data("state") == state).all() and (dataset.get_col_data("grid") == grid).all()
    assert (dataset.get_col_data("action") == state[:, :2]).all()


def test_costs_of_numpy_are_taken_by_value(world: Callable[..., Any]) -> None:
    class Cost:
        array_api = "numpy"

        def __init__(self, order: str) -> None:
            self.order: Any = order

        def get_cost(self, infos: Any, candidates: Any) -> Any:
            return np.array(np.square(candidates - 0.3).sum(axis=(2, 3)), order=self.order)

    plans = []
    for order in ("C", "F"):
        solver = swm.planning.CEMSolver(Cost(order), batch_size=3, num_samples=8, n_steps=3, topk=2)
        live = world(num_envs=3)
        solver.configure(action_space=live.envs.action_space, n_envs=3, config=swm.PlanConfig(horizon=2, receding_horizon=1))
        plans.append(solver.solve({"state": np.zeros((3, 1, 2), np.float32)})["actions"])
    assert (plans[0] == plans[1]).all()


def test_exported_weights_are_those_of_the_model(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxscript")
    from onnx import numpy_helper, reference
    from stable_worldmodel_rs.export import export_onnx

    weights = torch.arange(12, dtype=torch.float32).reshape(4, 3)

    class Encode(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.weights = torch.nn.Parameter(weights.T)  # (3, 4), not contiguous.
            self.register_buffer("turned", torch.from_numpy(np.asfortranarray(weights.numpy())))

        def forward(self, state: Any) -> dict[str, Any]:
            return {"start": state @ self.weights @ self.turned}

    class Cost(torch.nn.Module):
        def forward(self, actions: Any, start: Any) -> Any:
            return actions.sum(dim=(1, 2)) + start.sum()

    fields = {"state": torch.tensor([[1.0, 2.0, 5.0]])}
    sizes: dict[str, Any] = {"samples": 2, "horizon": 1, "dim": 2, "name": "turned", "action_block": 1}
    encode = Encode()
    export_onnx(tmp_path / "model", encode, Cost(), fields, gradient=False, **sizes)
    graph = onnx.load(tmp_path / "model/encode.onnx")
    held = [numpy_helper.to_array(one) for one in graph.graph.initializer]
    assert any(one.shape == (3, 4) and (one == weights.T.numpy()).all() for one in held)
    (found,) = reference.ReferenceEvaluator(graph).run(None, {"state": fields["state"].numpy()})
    np.testing.assert_allclose(found, encode(**fields)["start"].detach().numpy())
