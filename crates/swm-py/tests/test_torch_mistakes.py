"""What torch users do that works, or works with a warning: gradients that nobody wants, other types and devices, training mode."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm

torch = pytest.importorskip("torch")
import wrong_torch  # noqa: E402  it imports torch
from stable_worldmodel_rs.planning import CEMSolver, GoalMSE, ShootingCostEvaluator  # noqa: E402
from wrong_torch import Frames, ImageModel, NumpyCost, Returned, StateCost, WithDropout, act, plan  # noqa: E402


def warnings_of(caplog: pytest.LogCaptureFixture, call: Any) -> list[str]:
    with caplog.at_level(logging.WARNING, logger="stable_worldmodel_rs"):
        try:
            call()
        except RuntimeError:
            pass
    return caplog.messages


class Holder:
    """A cost that is no module and holds one."""

    def __init__(self, model: Any) -> None:
        self.model = model

    def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
        return self.model.get_cost(infos, candidates)


@pytest.mark.parametrize("wrapped", [False, True])
def test_training_mode_is_noted_once(wrapped: bool, caplog: pytest.LogCaptureFixture) -> None:
    cost = Holder(WithDropout()) if wrapped else WithDropout()
    [noted] = warnings_of(caplog, lambda: plan(cost))
    assert "plans in training mode, in which Dropout gives other costs at every call, so that results cannot be repeated" in noted
    caplog.clear()
    (cost.model if wrapped else cost).eval()
    assert warnings_of(caplog, lambda: plan(cost)) == []


def test_a_history_that_the_plan_does_not_keep_is_noted(caplog: pytest.LogCaptureFixture) -> None:
    noted = warnings_of(caplog, lambda: plan(Frames()))
    assert ["Frames has history_len=3, and PlanConfig(history_len=1) gives it fewer frames (T)" in text for text in noted] == [True]


def test_channels_last_are_noted_once(caplog: pytest.LogCaptureFixture) -> None:
    def last(image: Any) -> Any:
        return image.permute(1, 2, 0).float()

    cost = ShootingCostEvaluator(ImageModel(), GoalMSE())
    for _ in range(2):
        with pytest.raises(RuntimeError, match="channels"):
            plan(cost, transform={"pixels": last})
    [noted] = [text for text in caplog.messages if "[H, W, C]" in text]
    assert "transform['pixels'] returned images [32, 32, 3] of images [3, 32, 32]" in noted and "leave out its permute" in noted


class Weighted(StateCost):
    """A cost with parameters, that forgets `no_grad`, and keeps what it computed."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = torch.nn.Parameter(torch.ones(1))
        self.kept: list[Any] = []

    def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
        costs = super().get_cost(infos, candidates) * self.weight
        self.kept.append(costs)
        return costs


def test_costs_need_no_no_grad() -> None:
    cost = Weighted()
    plan(cost)
    # No graph is built, so that none can fill the memory.
    assert cost.kept and not any(costs.requires_grad for costs in cost.kept)


@pytest.mark.parametrize("dtype", ["float16", "bfloat16", "float64", "int64", "bool"])
def test_costs_of_any_real_type_are_taken(dtype: str) -> None:
    plan(Returned(lambda costs: costs.to(getattr(torch, dtype))))


def test_a_numpy_cost_may_return_tensors_with_gradients() -> None:
    plan(NumpyCost(lambda costs: torch.from_numpy(costs).requires_grad_()))


@pytest.mark.parametrize(
    "actions",
    [
        lambda infos: torch.zeros(2, 2, requires_grad=True),
        lambda infos: torch.zeros(2, 2, dtype=torch.bfloat16),
        lambda infos: torch.zeros(2, 2, dtype=torch.int64),
        lambda infos: [torch.zeros(2, requires_grad=True), torch.zeros(2)],
        lambda infos: [[0.0, 0.0], [0.0, 0.0]],
        lambda infos: (np.zeros(2), np.zeros(2)),
    ],
)
def test_actions_of_any_real_type_are_taken(actions: Any) -> None:
    act(actions)


class Doubling:
    """A scaler that returns tensors with a gradient."""

    def transform(self, values: Any) -> Any:
        return torch.as_tensor(values) * torch.full((1,), 2.0, requires_grad=True)

    def inverse_transform(self, values: Any) -> Any:
        return torch.as_tensor(values) / torch.full((1,), 2.0, requires_grad=True)


class Halved(Doubling):
    def inverse_transform(self, values: Any) -> Any:
        return super().inverse_transform(values)[..., :1]


def test_scalers_may_return_tensors_and_keep_shapes() -> None:
    plan(StateCost(), process={"action": Doubling()})
    with pytest.raises(ValueError, match=r"Halved.inverse_transform in process\['action'\] gave \[2, 1\] of actions \[N, \*A\] = \[2, 2\]"):
        plan(StateCost(), process={"action": Halved()})


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU here")
def test_a_gpu_that_is_not_there_is_named_before_the_plan() -> None:
    solver = CEMSolver(StateCost(), num_samples=8, n_steps=2, topk=2, device="cuda")
    live = wrong_torch.world()
    with pytest.raises(swm.PlanError, match=r"CEMSolver\(device='cuda'\): torch .* finds no such device here .*give device='cpu'"):
        live.set_policy(swm.WorldModelPolicy(solver, swm.PlanConfig(**wrong_torch.CONFIG)))
