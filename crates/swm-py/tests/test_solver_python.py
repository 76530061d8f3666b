"""Solvers among Python code: exceptions, Ctrl-C, threads, forks, pickles, callbacks, what is kept."""

from __future__ import annotations

import copy
import doctest
import importlib
import multiprocessing
import os
import pickle
import subprocess
import sys
import threading
import time
import traceback

import numpy as np
import pytest
from solver_helpers import Sum, configured, info
from stable_worldmodel_rs import PlanConfig, PlanError, SwmError
from stable_worldmodel_rs.planning import CEMSolver, GradientSolver, Solver
from stable_worldmodel_rs.planning.solver._base import PlanKeys


def test_candidates_may_be_kept():
    cost = Sum()
    configured(CEMSolver(cost, n_steps=5, num_samples=16, topk=4), n_envs=1).solve(info(1))
    kept = [seen.copy() for seen in cost.seen]
    configured(CEMSolver(cost, n_steps=5, num_samples=16, topk=4, seed=5), n_envs=1).solve(info(1))
    for seen, before in zip(cost.seen, kept):
        np.testing.assert_array_equal(seen, before)
    assert len({seen.__array_interface__["data"][0] for seen in cost.seen}) == 10
    assert all(seen.flags.owndata or seen.base is not None for seen in cost.seen)


def test_exceptions_of_a_cost_come_out_with_their_traceback():
    class Broken(Exception):
        pass

    class Cost:
        array_api = "numpy"

        def get_cost(self, info, candidates):
            raise Broken("no such model")

    solver = configured(CEMSolver(Cost()))
    with pytest.raises(Broken, match="no such model") as caught:
        solver.solve(info())
    frames = [frame.name for frame in traceback.extract_tb(caught.value.__traceback__)]
    assert frames[-1] == "get_cost"
    # The solver works afterwards.
    solver.cost = Sum()
    assert solver.solve(info())["actions"].shape == (4, 3, 4)


def test_threads_and_costs_that_plan_share_a_solver():
    solver = configured(CEMSolver(Sum(), n_steps=20, num_samples=64, topk=8))
    keys = PlanKeys(range(4), range(4), [0] * 4)
    expected = solver.solve(info(), keys=keys)["actions"]
    results = []
    threads = [threading.Thread(target=lambda: results.append(solver.solve(info(), keys=keys))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert len(results) == 4
    for result in results:
        np.testing.assert_array_equal(result["actions"], expected)

    inner = configured(CEMSolver(Sum(), n_steps=2, num_samples=16, topk=4), n_envs=1)

    class Nested(Sum):
        def get_cost(self, info, candidates):
            inner.solve({"state": np.zeros((1, 1))})
            return super().get_cost(info, candidates)

    assert configured(CEMSolver(Nested(), n_steps=2), n_envs=1).solve(info(1))["actions"].shape == (1, 3, 4)


INTERRUPTED = """
import os, signal, sys, threading, time
import gymnasium as gym, numpy as np
from stable_worldmodel_rs import PlanConfig
from stable_worldmodel_rs.planning import CEMSolver

class Sum:
    array_api = "numpy"
    def get_cost(self, info, candidates):
        return candidates.sum(axis=(2, 3))

solver = CEMSolver(Sum(), n_steps=1_000_000, num_samples=16, topk=4)
solver.configure(action_space=gym.spaces.Box(-1, 1, (1, 2)), n_envs=1, config=PlanConfig(3, 2))
sent = []
def interrupt():
    time.sleep(0.3)
    sent.append(time.monotonic())
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=interrupt).start()
try:
    solver.solve({"state": np.zeros((1, 1))})
except KeyboardInterrupt:
    print(time.monotonic() - sent[0])
"""


def test_ctrl_c_ends_a_search_at_once():
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 0.3


def _plan_in_child(solver, results):
    try:
        solver.solve(info())
        results.put("planned")
    except SwmError as error:
        results.put(str(error))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_fork_refuses_to_plan_and_does_not_hang():
    solver = configured(CEMSolver(Sum(), n_steps=2, num_samples=16, topk=4))
    solver.solve(info())
    context = multiprocessing.get_context("fork")
    for one in (solver, copy.deepcopy(solver)):
        results = context.Queue()
        child = context.Process(target=_plan_in_child, args=(one, results))
        child.start()
        said = results.get(timeout=60)
        child.join(60)
        assert "fork" in said


def test_solvers_are_pickled_by_their_arguments():
    solver = configured(CEMSolver(Sum(), n_steps=2, num_samples=16, topk=4))
    again = pickle.loads(pickle.dumps(solver))
    np.testing.assert_array_equal(again.solve(info())["actions"], solver.solve(info())["actions"])


def test_before_configure():
    solver = CEMSolver(Sum())
    assert solver.n_envs is None and not solver._configured
    with pytest.raises(AssertionError, match="call configure"):
        solver.solve(info())
    assert isinstance(configured(solver), Solver)
    assert repr(solver).startswith("CEMSolver(Sum, samples=300, iterations=30, ")
    with pytest.raises(PlanError, match="no rows"):
        solver.solve({"state": np.zeros((0, 1))})


def test_callbacks_see_arrays_of_every_iteration():
    from stable_worldmodel_rs.planning.solver.callbacks import (
        ActionNormRecorder,
        BestCostRecorder,
        Callback,
        EliteCostRecorder,
        EliteSpreadRecorder,
        GradNormRecorder,
        MeanCostRecorder,
        MeanShiftRecorder,
        VarNormRecorder,
    )

    class Keep(Callback):
        name = "kept"

        def compute(self, **state):
            return state

    recorders = [BestCostRecorder("none"), MeanCostRecorder(), EliteCostRecorder(), EliteSpreadRecorder()]
    recorders += [VarNormRecorder(), MeanShiftRecorder(), Keep()]
    cost = Sum()
    solver = configured(CEMSolver(cost, 2, 32, n_steps=3, topk=5, callbacks=recorders))
    result = solver.solve(info())
    histories = result["callbacks"]
    assert all(len(history) == 2 and len(history[0]) == 3 for history in histories.values())
    first, second = histories["kept"][0][:2]
    np.testing.assert_array_equal(first["candidates"], cost.seen[0])
    np.testing.assert_array_equal(first["prev_mean"], np.zeros((2, 3, 4)))
    assert (first["prev_var"] == 1.0).all()
    np.testing.assert_array_equal(second["prev_mean"], first["mean"])
    np.testing.assert_array_equal(second["prev_var"], first["var"])
    np.testing.assert_allclose(first["topk_candidates"].mean(1), first["mean"], rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(np.take_along_axis(first["costs"], first["topk_inds"], 1), first["topk_vals"])
    np.testing.assert_allclose(histories["BestCostRecorder"][0][0], first["costs"].min(1))
    # Another solve begins anew.
    assert len(solver.solve(info())["callbacks"]["kept"]) == 2

    descent = configured(GradientSolver(Sum(), 3, callbacks=[GradNormRecorder(), ActionNormRecorder()]))
    histories = descent.solve(info())["callbacks"]
    # The gradient of (sum - 2)² at zeros is -4 in each of 12 values.
    assert histories["GradNormRecorder"][0][0] == pytest.approx(4 * 12**0.5)
    assert histories["ActionNormRecorder"][0][0] == 0.0


def test_an_exception_of_a_callback_ends_the_solve():
    from stable_worldmodel_rs.planning.solver.callbacks import Callback

    class Fails(Callback):
        def compute(self, **state):
            raise ZeroDivisionError(state["step"])

    cost = Sum()
    solver = configured(CEMSolver(cost, n_steps=9, num_samples=16, topk=4, callbacks=[Fails()]), n_envs=1)
    with pytest.raises(ZeroDivisionError):
        solver.solve(info(1))
    assert len(cost.seen) == 1


def test_logging_is_quiet(capsys):
    configured(CEMSolver(Sum(), n_steps=2)).solve(info())
    assert capsys.readouterr() == ("", "")


def test_time_of_a_search_is_its_cost():
    """A guard against accidental work per iteration, not a benchmark: those are in benches/peers."""
    solver = configured(CEMSolver(Sum(), n_steps=1000, num_samples=8, topk=4), n_envs=1, config=PlanConfig(1, 1))
    solver.solve(info(1))
    begun = time.process_time()
    solver.solve(info(1))
    assert time.process_time() - begun < 0.5


@pytest.mark.parametrize(
    "module", ["buffer", "planning.mpc", "planning.solver.cem", "planning.solver.callbacks.common", "policy"]
)
def test_examples_of_the_docs_run(module):
    failed, attempted = doctest.testmod(importlib.import_module(f"stable_worldmodel_rs.{module}"))
    assert attempted > 0 and failed == 0
