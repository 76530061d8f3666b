"""Searches over NumPy costs: what solvers evaluate and return, settings, and errors. Needs no torch."""

from __future__ import annotations

import json

import gymnasium as gym
import numpy as np
import pytest
from solver_helpers import Sum, configured, info
from stable_worldmodel_rs import PlanError, SwmError, _swm
from stable_worldmodel_rs.planning import (
    CategoricalCEMSolver,
    CEMSolver,
    CMAESSolver,
    FullCEMSolver,
    GradientSolver,
    ICEMSolver,
    LagrangianSolver,
    MPPISolver,
    PGDSolver,
    PredictiveSamplingSolver,
)
from stable_worldmodel_rs.planning.solver._base import PlanKeys

SAMPLING = [CEMSolver, ICEMSolver, MPPISolver, FullCEMSolver, CMAESSolver]


@pytest.mark.parametrize("make", SAMPLING)
def test_sampling_solvers_find_the_plan_and_ask_once_per_iteration_and_chunk(make):
    cost = Sum()
    solver = configured(make(cost, n_steps=6, num_samples=64, batch_size=3))
    solver.topk = 8
    result = solver.solve(info())
    assert result["actions"].shape == (4, 3, 4) and result["actions"].dtype == np.float32
    assert [seen.shape for seen in cost.seen] == [(3, 64, 3, 4)] * 6 + [(1, 64, 3, 4)] * 6
    assert all(seen.dtype == np.float32 for seen in cost.seen)
    assert len(result["costs"]) == 4 and all(isinstance(value, float) for value in result["costs"])
    (mean,), (std,) = result["mean"], result["var"]
    assert mean.shape == std.shape == (4, 3, 4)
    before = cost.seen[0][0, 1:].sum(axis=(1, 2)) - 2.0
    assert np.all((result["actions"].sum(axis=(1, 2)) - 2.0) ** 2 < np.median(before**2))


def test_elites_are_refitted_to_mean_and_unbiased_deviation():
    cost = Sum()
    solver = configured(CEMSolver(cost, n_steps=3, num_samples=32, topk=5), n_envs=1)
    result = solver.solve(info(1))
    last = cost.seen[-1][0]
    elites = last[np.argsort(cost.get_cost({}, last[None])[0], kind="stable")[:5]]
    np.testing.assert_allclose(result["actions"][0], elites.mean(0), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(result["var"][0][0], elites.std(0, ddof=1), rtol=1e-4, atol=1e-6)
    assert result["costs"][0] == pytest.approx(np.sort(cost.get_cost({}, last[None])[0])[:5].mean())
    # The first candidate of every iteration is the mean, at first zeros.
    assert not cost.seen[0][0, 0].any()


def test_mppi_weighs_its_elites_by_a_softmax():
    cost = Sum()
    solver = configured(MPPISolver(cost, n_steps=1, num_samples=32, topk=6, temperature=0.7), n_envs=1)
    result = solver.solve(info(1))
    costs = cost.get_cost({}, cost.seen[0])[0]
    order = np.argsort(costs, kind="stable")[:6]
    weights = np.exp(-(costs[order] - costs[order[0]]) / 0.7)
    expected = (weights[:, None, None] * cost.seen[0][0, order]).sum(0) / weights.sum()
    np.testing.assert_allclose(result["actions"][0], expected, rtol=1e-4, atol=1e-6)
    assert (result["var"][0] == 1.0).all()


def test_predictive_sampling_takes_the_cheapest():
    cost = Sum()
    solver = configured(PredictiveSamplingSolver(cost, num_samples=20, noise_scale=0.5), n_envs=1)
    result = solver.solve(info(1))
    assert len(cost.seen) == 1
    costs = cost.get_cost({}, cost.seen[0])[0]
    np.testing.assert_array_equal(result["actions"][0], cost.seen[0][0, costs.argmin()])
    assert result["costs"] == [pytest.approx(costs.min())]


def test_icem_clips_to_the_bounds_and_keeps_elites():
    cost = Sum()
    solver = configured(ICEMSolver(cost, n_steps=3, num_samples=40, topk=6, var_scale=5.0), n_envs=1)
    solver.solve(info(1))
    assert all(np.abs(seen).max() <= 1.0 for seen in cost.seen)
    costs = cost.get_cost({}, cost.seen[0])[0]
    elites = cost.seen[0][0, np.argsort(costs, kind="stable")[:5]]
    np.testing.assert_array_equal(cost.seen[1][0, 1:6], elites)


def test_the_best_candidate_is_returned_on_request():
    cost = Sum()
    solver = configured(ICEMSolver(cost, n_steps=2, num_samples=30, topk=5, return_mean=False), n_envs=1)
    result = solver.solve(info(1))
    every = np.concatenate([seen[0] for seen in cost.seen])
    costs = cost.get_cost({}, every[None])[0]
    np.testing.assert_array_equal(result["actions"][0], every[costs.argmin()])
    assert result["costs"][0] == costs.min()


@pytest.mark.parametrize("make", SAMPLING)
def test_plans_do_not_depend_on_the_rows_beside_them(make):
    keys = PlanKeys(slots=[0, 1, 2, 3], seeds=[7, 8, 9, 10], plans=[0, 3, 1, 2])

    def plans(batch, rows=slice(None)):
        elites = {} if make is CMAESSolver else {"topk": 8}
        solver = configured(make(Sum(), n_steps=3, num_samples=16, batch_size=batch, **elites))
        some = PlanKeys(*(values[rows] for values in keys))
        return solver.solve(info(len(some.seeds)), keys=some)["actions"]

    all_at_once = plans(4)
    np.testing.assert_array_equal(plans(1), all_at_once)
    np.testing.assert_array_equal(plans(3, slice(1, 3)), all_at_once[1:3])


def test_noise_depends_on_the_seed_the_episode_and_the_plan():
    def plan(seed=0, episode=1, number=0):
        solver = configured(CEMSolver(Sum(), n_steps=2, num_samples=16, topk=4, seed=seed), n_envs=1)
        return solver.solve(info(1), keys=PlanKeys([0], [episode], [number]))["actions"]

    base = plan()
    np.testing.assert_array_equal(base, plan())
    for other in (plan(seed=1), plan(episode=2), plan(number=1)):
        assert not np.array_equal(base, other)


def test_calls_without_keys_differ_and_repeat():
    def two():
        solver = configured(CEMSolver(Sum(), n_steps=2, num_samples=16, topk=4))
        return solver.solve(info())["actions"], solver(info())["actions"]

    (a, b), (c, d) = two(), two()
    assert not np.array_equal(a, b)
    np.testing.assert_array_equal(a, c)
    np.testing.assert_array_equal(b, d)


def test_infos_have_a_candidate_axis_and_are_one_dict_per_solve():
    class Look:
        array_api = "numpy"
        dicts = []

        def get_cost(self, info, candidates):
            self.dicts.append(info)
            assert info["state"].shape == (2, 8, 1, 5) and info["state"].strides[1] == 0
            assert info["names"] == ["a", "b"] and info["tag"] == "hello" and info["none"] is None
            info.setdefault("calls", 0)
            info["calls"] += 1
            return candidates.sum(axis=(2, 3))

    look = Look()
    solver = configured(CEMSolver(look, batch_size=2, n_steps=3, num_samples=8, topk=4), n_envs=2)
    solver.solve({"state": np.zeros((2, 1, 5)), "names": ["a", "b"], "tag": "hello", "none": None})
    assert len({id(one) for one in look.dicts}) == 1 and look.dicts[0]["calls"] == 3


def test_warm_starts_are_padded_with_zeros():
    cost = Sum()
    solver = configured(CEMSolver(cost, n_steps=1, num_samples=8, topk=4), n_envs=1)
    start = np.arange(8, dtype=np.float64).reshape(1, 2, 4)
    solver.solve(info(1), init_action=start)
    np.testing.assert_array_equal(cost.seen[0][0, 0], np.concatenate([start[0], np.zeros((1, 4))]))
    with pytest.raises(PlanError, match=r"init_action has the shape \(1, 2, 3\)"):
        solver.solve(info(1), init_action=np.zeros((1, 2, 3)))


def test_gradients_of_numpy_costs():
    cost = Sum()
    solver = configured(GradientSolver(cost, n_steps=40, num_samples=3, optimizer_kwargs={"lr": 0.01}))
    result = solver.solve(info())
    np.testing.assert_allclose(result["actions"].sum(axis=(1, 2)), 2.0, atol=1e-3)
    assert max(result["costs"]) < 1e-5
    # The cost is asked with gradients in every step, and once for the ends.
    assert len(cost.seen) == 41

    class Plain:
        array_api = "numpy"

        def get_cost(self, info, candidates):
            return candidates.sum(axis=(2, 3))

    with pytest.raises(PlanError, match="get_cost_and_gradient"):
        configured(GradientSolver(Plain(), n_steps=2)).solve(info())


def test_optimizers_are_named():
    for name in ("SGD", "adam", "AdamW"):
        assert configured(GradientSolver(Sum(), 3, optimizer_cls=name)).solve(info())["actions"].shape == (4, 3, 4)
    solver = GradientSolver(Sum(), 3, optimizer_cls="adam", optimizer_kwargs={"betas": (0.8, 0.9), "amsgrad": False})
    assert solver.settings()["beta1"] == 0.8
    with pytest.raises(ValueError, match="SGD, Adam or AdamW, not with 'rmsprop'"):
        GradientSolver(Sum(), 3, optimizer_cls="rmsprop")
    with pytest.raises(ValueError, match="does not know optimizer_kwargs dampening"):
        GradientSolver(Sum(), 3, optimizer_kwargs={"lr": 0.1, "dampening": 0.5})


def test_spaces_that_do_not_fit():
    with pytest.raises(AssertionError, match="CategoricalCEMSolver plans integers"):
        configured(CategoricalCEMSolver(Sum()))
    with pytest.raises(PlanError, match="PGDSolver plans integers"):
        configured(PGDSolver(Sum(), 3))
    solver = configured(CEMSolver(Sum(), n_steps=1), gym.spaces.Discrete(3))
    with pytest.raises(PlanError, match="cem cannot plan these actions"):
        solver.solve(info())
    single = gym.spaces.Box(-1, 1, (3,), np.float32)
    assert configured(CEMSolver(Sum()), single, n_envs=1).action_dim == 6
    assert configured(CEMSolver(Sum()), single, n_envs=3).action_dim == 2
    with pytest.raises(TypeError, match="ActionWrapper"):
        configured(CEMSolver(Sum()), gym.spaces.Dict({}))


def test_wrong_costs_are_named():
    class Wrong:
        array_api = "numpy"

        def __init__(self, value):
            self.value = value

        def get_cost(self, info, candidates):
            return self.value

    solver = configured(CEMSolver(Wrong(np.zeros(3)), n_steps=1, num_samples=16, topk=4), n_envs=1)
    with pytest.raises(AssertionError, match=r"Wrong.get_cost returned an array \[3\] of float64; expected costs \[B, S\] = \[1, 16\]"):
        solver.solve(info(1))
    solver.cost = Wrong(np.full((1, 16), np.nan))
    with pytest.raises(PlanError, match="all 16 candidates have a cost that is not finite"):
        solver.solve(info(1))
    solver.cost = Wrong(np.arange(16)[None])
    assert solver.solve(info(1))["costs"] == [1.5]


def test_settings_out_of_range_are_named():
    for make in (CEMSolver, ICEMSolver, FullCEMSolver, CategoricalCEMSolver):
        with pytest.raises(PlanError, match="setting `topk`: 30 of 16 samples"):
            make(Sum(), num_samples=16, topk=30)
    with pytest.raises(PlanError, match="setting `num_samples`: 0"):
        GradientSolver(Sum(), 5, num_samples=0)
    changed = CEMSolver(Sum(), num_samples=40)
    changed.num_samples = 16
    with pytest.raises(PlanError, match="setting `topk`: 30 of 16 samples"):
        configured(changed).solve(info())


def test_settings_of_a_class_of_ones_own_are_checked_when_all_are_there():
    class Narrow(CEMSolver):
        def __init__(self, cost, share):
            super().__init__(cost, num_samples=40)
            self.share = share

        def settings(self):
            return {**super().settings(), "elites": round(self.share * self.num_samples)}

    assert "elites=10" in repr(Narrow(Sum(), 0.25))
    with pytest.raises(PlanError, match="setting `topk`: 60 of 40 samples"):
        Narrow(Sum(), 1.5)


def test_names_of_solvers_are_known():
    with pytest.raises(SwmError, match="unknown solver `cen`.*did you mean `cem`"):
        _swm.Solver("cen", "{}")
    assert json.loads(_swm.Solver("cem", '{"samples": 99}').changed_settings()) == {"samples": 99}
    names = [name for name, _, _ in _swm.solvers()]
    assert {"cem", "icem", "mppi", "cma-es", "lagrangian", "pgd"} <= set(names)


def test_constraints_of_numpy_costs_name_the_fix():
    class Bounded(Sum):
        def get_constraints(self, info, candidates):
            return candidates.mean(axis=(2, 3))[..., None]

    with pytest.raises(PlanError, match="gradients of constraints need torch"):
        configured(LagrangianSolver(Bounded(), 2)).solve(info())
    result = configured(LagrangianSolver(Sum(), 100, optimizer_kwargs={"lr": 0.02})).solve(info())
    assert result["lambdas"] is None and result["constraint_violation"] == []
    np.testing.assert_allclose(result["actions"].sum(axis=(1, 2)), 2.0, atol=0.05)
