"""Solvers over torch costs: types, devices, modes, and gradients as torch's own optimizers would use them."""

from __future__ import annotations

import threading

import gymnasium as gym
import numpy as np
import pytest
from solver_helpers import configured, info
from stable_worldmodel_rs import PlanConfig, PlanError
from stable_worldmodel_rs.planning import (
    CategoricalCEMSolver,
    CEMSolver,
    GradientSolver,
    ICEMSolver,
    LagrangianSolver,
    PGDSolver,
    PredictiveSamplingSolver,
)

torch = pytest.importorskip("torch")


class Quadratic(torch.nn.Module):
    """Distance of every value from a target that grows along the plan."""

    def __init__(self):
        super().__init__()
        self.scale = torch.nn.Parameter(torch.tensor(1.5))
        self.candidates = []

    def get_cost(self, info, candidates):
        self.candidates.append(candidates.detach().clone())
        target = torch.linspace(0, 1, candidates.shape[2], dtype=candidates.dtype)[:, None]
        return (self.scale * (candidates - target) ** 2).sum(dim=(2, 3))


def test_tensors_in_and_out():
    class Look:
        def get_cost(self, info, candidates):
            assert torch.is_inference_mode_enabled() and threading.get_ident() == self.thread
            assert candidates.shape == (2, 16, 3, 4) and candidates.dtype == torch.float32
            assert info["x"].shape == (2, 16, 1, 5) and info["x"].stride(1) == 0 and info["x"].dtype == torch.float32
            assert info["n"].dtype == torch.int64 and isinstance(info["array"], np.ndarray)
            return candidates.sum(dim=(2, 3)).double()

    look = Look()
    look.thread = threading.get_ident()
    given = {"x": torch.zeros(2, 1, 5, dtype=torch.float64), "n": torch.zeros(2, 1).long(), "array": np.zeros((2, 1))}
    result = configured(CEMSolver(look, 2, 16, n_steps=3, topk=4)).solve(given)
    assert result["actions"].dtype == torch.float32 and result["actions"].shape == (2, 3, 4)
    assert not result["actions"].is_inference()
    assert torch.is_tensor(result["mean"][0]) and result["var"][0].shape == (2, 3, 4)


def test_the_same_plan_from_arrays_and_tensors():
    class First:
        def get_cost(self, info, candidates):
            return candidates[:, :, 0, 1]

    class FirstOfArray(First):
        array_api = "numpy"

    for make in (CEMSolver, ICEMSolver, PredictiveSamplingSolver):
        tensors = configured(make(First(), num_samples=64)).solve({"x": torch.zeros(4, 1)})["actions"]
        arrays = configured(make(FirstOfArray(), num_samples=64)).solve(info())["actions"]
        np.testing.assert_array_equal(tensors.numpy(), arrays)


@pytest.mark.parametrize("dtype", [torch.float64, torch.bfloat16, torch.float16])
def test_candidates_have_the_type_of_the_model(dtype):
    model = Quadratic().to(dtype)
    for solver in (CEMSolver(model, n_steps=2), GradientSolver(model, 2, optimizer_kwargs={"lr": 0.01})):
        assert solver.dtype == dtype
        result = configured(solver).solve({"x": torch.zeros(4, 1)})
        assert result["actions"].dtype == torch.float32
    assert {candidates.dtype for candidates in model.candidates} == {dtype}


@pytest.mark.parametrize(
    ("optimizer", "kwargs"),
    [
        (torch.optim.SGD, {"lr": 0.1}),
        (torch.optim.SGD, {"lr": 0.05, "momentum": 0.9, "nesterov": True}),
        (torch.optim.Adam, {"lr": 0.1, "betas": (0.8, 0.95), "weight_decay": 0.1}),
        (torch.optim.AdamW, {"lr": 0.1}),
    ],
)
@pytest.mark.parametrize("grad_clip", [None, 0.5])
def test_descent_is_that_of_torch(optimizer, kwargs, grad_clip):
    model = Quadratic()
    solver = configured(
        GradientSolver(
            model, 12, num_samples=3, optimizer_cls=optimizer, optimizer_kwargs=kwargs, grad_clip=grad_clip,
            grad_clip_mode="global",
        ),
        n_envs=2,
    )  # fmt: skip
    solver.init_action(2)
    params = solver.init.clone().requires_grad_(True)
    steps = optimizer([params], **kwargs)
    for _ in range(12):
        (params.grad,) = torch.autograd.grad(model.get_cost({}, params).sum(), params)
        if grad_clip is not None:
            torch.nn.utils.clip_grad_norm_(params, grad_clip)
        steps.step()
    costs = model.get_cost({}, params).detach()
    best = params.detach()[torch.arange(2), costs.argmin(1)]
    model.candidates.clear()
    result = solver.solve({"x": torch.zeros(2, 1)})
    torch.testing.assert_close(model.candidates[0], solver.init)
    torch.testing.assert_close(result["actions"], best, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(result["costs"], costs.min(1).values, rtol=1e-4)
    assert model.scale.grad is None
    assert len(model.candidates) == 13


class Bounded(torch.nn.Module):
    """Everything should be 1, and the mean no more than 0.4, the first value no more than 0.2."""

    def get_cost(self, info, candidates):
        return ((candidates - 1.0) ** 2).mean(dim=(2, 3))

    def get_constraints(self, info, candidates):
        return torch.stack([candidates.mean(dim=(2, 3)) - 0.4, candidates[..., 0, 0] - 0.2], dim=-1)


def test_lagrangian_of_the_reference():
    model, rho, rounds, steps = Bounded(), 1.0, 4, 6
    solver = configured(LagrangianSolver(model, steps, rounds, optimizer_kwargs={"lr": 0.05}), n_envs=2)
    plan, lambdas = torch.zeros(2, 1, 3, 4, requires_grad=True), torch.zeros(2, 2)
    for _ in range(rounds):
        optimizer = torch.optim.Adam([plan], lr=0.05)
        for _ in range(steps):
            g = model.get_constraints({}, plan)
            loss = model.get_cost({}, plan) + (lambdas[:, None] * g).sum(-1) + rho * g.relu().pow(2).sum(-1)
            (plan.grad,) = torch.autograd.grad(loss.sum(), plan)
            optimizer.step()
        g = model.get_constraints({}, plan).detach()
        lambdas, rho = (lambdas + rho * g.mean(1)).clamp(min=0), 2 * rho
    result = solver.solve({"x": torch.zeros(2, 1)})
    torch.testing.assert_close(result["actions"], plan.detach()[:, 0], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(result["lambdas"], lambdas, rtol=1e-4, atol=1e-5)
    assert result["constraint_violation"] == [pytest.approx(float(g.relu().mean()), abs=1e-5)]
    # Multipliers of the last plan are where the next begins, unless told otherwise.
    again = solver.solve({"x": torch.zeros(2, 1)})
    assert not torch.equal(again["lambdas"], result["lambdas"])
    fresh = LagrangianSolver(model, steps, rounds, optimizer_kwargs={"lr": 0.05}, persist_multipliers=False)
    configured(fresh, n_envs=2)
    first, second = (fresh.solve({"x": torch.zeros(2, 1)})["lambdas"] for _ in range(2))
    torch.testing.assert_close(first, second)


def test_the_standard_lagrangian_satisfies_its_constraints():
    solver = LagrangianSolver(
        Bounded(), 60, 8, num_samples=4, form="standard", optimizer_kwargs={"lr": 0.02}, batch_size=1
    )
    result = configured(solver).solve({})
    g = Bounded().get_constraints({}, result["actions"][:, None])
    assert g.max() < 0.01
    assert result["lambdas"].shape == (4, 2) and (result["lambdas"] >= 0).all()
    assert len(result["constraint_violation"]) == 4


def test_costs_without_gradient_are_refused():
    class Cut:
        def get_cost(self, info, candidates):
            return candidates.detach().sum(dim=(2, 3))

    for solver in (GradientSolver(Cut(), 2), LagrangianSolver(Cut(), 2)):
        with pytest.raises(AssertionError, match="do not require any; remove `detach"):
            configured(solver).solve({})

    class Array:
        def get_cost(self, info, candidates):
            return np.zeros(candidates.shape[:2])

    with pytest.raises(PlanError, match='Array.get_cost returned an array .*; expected a torch.Tensor of costs .* or set `array_api'):
        configured(CEMSolver(Array())).solve({})


def test_integers_of_torch():
    class Favor(torch.nn.Module):
        def get_cost(self, info, candidates):
            return -candidates.reshape(*candidates.shape[:3], -1, 4)[..., 2].sum(dim=(2, 3))

    space = gym.spaces.Discrete(4)
    for solver in (CategoricalCEMSolver(Favor(), n_steps=8, num_samples=64, topk=8), PGDSolver(Favor(), 5)):
        result = configured(solver, space).solve({"x": torch.zeros(4, 1)})
        assert result["actions"].dtype == torch.int64 and result["actions"].shape == (4, 3, 2)
        assert (result["actions"] == 2).all()
    probs = solver_probs(space, Favor())
    torch.testing.assert_close(probs.sum(-1), torch.ones(4, 3, 2))


def solver_probs(space, cost):
    solver = configured(CategoricalCEMSolver(cost, n_steps=3, num_samples=32, topk=8, smoothing=0.1), space)
    assert torch.allclose(solver.init_probs(4), torch.full((4, 3, 2, 4), 0.25))
    return solver.solve({"x": torch.zeros(4, 1)})["probs"][0]


def test_what_the_reference_calls_before_a_search():
    solver = configured(CEMSolver(Quadratic()), n_envs=2)
    mean, var = solver.init_action_distrib(2, torch.ones(2, 1, 4))
    assert mean.shape == var.shape == (2, 3, 4) and (mean[:, 0] == 1).all() and not mean[:, 1:].any()
    clipped = configured(ICEMSolver(Quadratic()), n_envs=2)
    torch.testing.assert_close(clipped._action_high, torch.ones(4))
    descent = configured(GradientSolver(Quadratic(), 2, num_samples=4, var_scale=0.5), n_envs=2)
    descent.init_action(2, torch.ones(2, 1, 4))
    assert descent.init.shape == (2, 4, 3, 4)
    torch.testing.assert_close(descent.init[:, 0, 0], torch.ones(2, 4))
    assert 0.3 < float((descent.init[:, 1:] - descent.init[:, :1]).std()) < 0.7


def test_an_actor_continues_a_warm_start():
    class Acting(Quadratic):
        def get_action(self, info, horizon=1, prefix_actions=None):
            assert prefix_actions is None or prefix_actions.shape[1] == 3 - horizon
            return torch.full((len(info["x"]), horizon, 4), 0.5)

    model = Acting()
    solver = configured(CEMSolver(model, n_steps=1), n_envs=2)
    solver.solve({"x": torch.zeros(2, 1)}, init_action=torch.ones(2, 1, 4))
    expected = torch.tensor([1.0, 0.5, 0.5])[:, None].expand(3, 4)
    torch.testing.assert_close(model.candidates[0][0, 0], expected)


def test_callbacks_see_tensors():
    from stable_worldmodel_rs.planning.solver.callbacks import Callback

    class Keep(Callback):
        def compute(self, **state):
            return state

    first = configured(ICEMSolver(Quadratic(), n_steps=2, callbacks=[Keep()])).solve({"x": torch.zeros(4, 1)})
    state = first["callbacks"]["Keep"][0][0]
    assert all(torch.is_tensor(value) for name, value in state.items() if name != "step")
    assert not state["candidates"].is_inference() or state["candidates"].shape == (1, 300, 3, 4)
    torch.testing.assert_close(state["action_low"], -torch.ones(4))
    descent = configured(GradientSolver(Quadratic(), 2, callbacks=[Keep()])).solve({"x": torch.zeros(4, 1)})
    state = descent["callbacks"]["Keep"][0][0]
    assert state["params"].grad.shape == state["params"].shape == (4, 1, 3, 4)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_candidates_are_on_the_device():
    class Look:
        def get_cost(self, info, candidates):
            assert candidates.is_cuda and info["x"].is_cuda
            return candidates.pow(2).sum(dim=(2, 3))

    for solver in (CEMSolver(Look(), device="cuda", n_steps=2), GradientSolver(Look(), 2, device="cuda")):
        result = configured(solver).solve({"x": torch.zeros(4, 1)}, init_action=torch.ones(4, 1, 4, device="cuda"))
        assert not result["actions"].is_cuda


def test_plans_of_one_block():
    solver = configured(CEMSolver(Quadratic(), n_steps=2), config=PlanConfig(1, 1))
    assert solver.solve({"x": torch.zeros(4, 1)})["actions"].shape == (4, 1, 2)
