"""Arguments of solvers: the reference's order, the core's settings, defaults that differ, documentation, pickles, and classes of a user's own."""

from __future__ import annotations

import copy
import inspect
import json
import pickle
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest
from solver_helpers import Sum, configured, info
from stable_worldmodel_rs import PlanError, _swm, planning
from stable_worldmodel_rs.planning import CEMSolver, GradientSolver, ICEMSolver, PredictiveSamplingSolver
from stable_worldmodel_rs.planning.solver._settings import KEYWORDS, setting_of

# Positional arguments of the reference, whose first one is called `model` there.
SAMPLED = "cost batch_size num_samples var_scale n_steps topk"
DESCENT = "cost n_steps batch_size var_scale num_samples action_noise device seed"
POSITIONAL = {
    "CEMSolver": f"{SAMPLED} device seed callbacks",
    "ICEMSolver": f"{SAMPLED} noise_beta alpha n_elite_keep return_mean device seed callbacks",
    "MPPISolver": f"{SAMPLED} temperature device seed callbacks",
    "FullCEMSolver": f"{SAMPLED} device seed callbacks",
    "CMAESSolver": "cost batch_size num_samples var_scale n_steps device seed callbacks",
    "PredictiveSamplingSolver": "cost batch_size num_samples noise_scale device seed",
    "CategoricalCEMSolver": "cost batch_size num_samples n_steps topk smoothing alpha device seed callbacks",
    "GradientSolver": f"{DESCENT} optimizer_cls optimizer_kwargs grad_clip callbacks",
    "PGDSolver": DESCENT,
    "LagrangianSolver": "cost n_steps n_outer_steps batch_size num_samples var_scale action_noise rho_init rho_max rho_scale "
    "persist_multipliers device seed optimizer_cls optimizer_kwargs",
}
CLASSES = [getattr(planning, name) for name in POSITIONAL]
TABLE = {name: {setting: json.loads(default) if default[0] in "0123456789tf" else default for setting, _, default in settings}
         for name, _, settings in _swm.solvers()}  # fmt: skip

# Defaults of the reference that are not the core's.
DIFFERS = {
    "GradientSolver": {"samples": 1, "lr": 1.0},
    "PGDSolver": {"samples": 1, "select": "relaxed"},
    "LagrangianSolver": {"samples": 1, "lr": 1.0, "form": "reference"},
}
# Settings of the core that have no argument here.
OPTIMIZED = {"grad_clip", "grad_clip_mode", "track_best"}
ABSENT = {
    "ICEMSolver": {"normalize", "mean_at_last"},
    "GradientSolver": {"momentum", "nesterov"},
    "PGDSolver": OPTIMIZED,
    "LagrangianSolver": OPTIMIZED | {"persist"},
}


def made(kind: Any, **arguments: Any) -> Any:
    """A solver with defaults; the number of gradient steps has none."""
    needed = {"n_steps": 30} if inspect.signature(kind).parameters["n_steps"].default is inspect.Parameter.empty else {}
    return kind(Sum(), **(needed | arguments))


@pytest.mark.parametrize("kind", CLASSES)
def test_positional_arguments_are_those_of_the_reference(kind):
    parameters = inspect.signature(kind).parameters.values()
    positional = [one.name for one in parameters if one.kind is one.POSITIONAL_OR_KEYWORD]
    assert positional == POSITIONAL[kind.__name__].split()
    solver = made(kind)
    assert all(getattr(solver, one.name) == one.default for one in parameters
               if one.default not in (one.empty, None))  # fmt: skip
    assert solver.callbacks == []


@pytest.mark.parametrize("kind", CLASSES)
def test_settings_are_those_of_the_core_and_defaults_differ_where_it_is_stated(kind):
    solver = made(kind)
    core = TABLE[solver.native_name]
    settings = solver.settings()
    assert set(settings) == set(core) - {"seed"} - ABSENT.get(kind.__name__, set())
    if kind.__name__ != "LagrangianSolver":
        assert [name for name in core if name in settings] == list(settings), "the order of the core's table"
    assert {name: value for name, value in settings.items() if value != core[name]} == DIFFERS.get(kind.__name__, {})


def test_keywords_name_settings():
    names = {name for settings in TABLE.values() for name in settings}
    keywords = {field.name for kind in CLASSES for field in fields(kind)}
    assert set(KEYWORDS) <= keywords and set(KEYWORDS.values()) <= names and not set(KEYWORDS) & names


@pytest.mark.parametrize("kind", CLASSES)
def test_all_arguments_are_documented_in_their_order(kind):
    text = inspect.getdoc(kind)
    own, _, rest = text.partition("\nArgs:\n")[2].partition("\n\n")
    entries = [line.strip().partition(": ") for line in own.splitlines() if not line.startswith("     ")]
    assert [name for name, _, _ in entries] == list(inspect.signature(kind).parameters)
    assert all(text[0].isupper() or text[0] == "`" for _, _, text in entries)
    assert "Args:" not in rest


def test_what_the_core_documents_is_in_the_documentation():
    (doc,) = (doc for setting, doc, _ in dict((name, settings) for name, _, settings in _swm.solvers())["icem"] if setting == "noise_beta")
    assert f"noise_beta: {doc}." in inspect.getdoc(ICEMSolver)


def test_errors_name_the_keyword_of_the_class():
    with pytest.raises(PlanError, match="setting `noise_scale`: -1"):
        PredictiveSamplingSolver(Sum(), noise_scale=-1)
    with pytest.raises(PlanError, match="setting `n_elite_keep`"):
        ICEMSolver(Sum(), n_elite_keep=-1)
    with pytest.raises(TypeError, match=r"CEMSolver.__init__\(\) got an unexpected keyword argument 'samples'"):
        CEMSolver(Sum(), samples=3)
    with pytest.raises(TypeError, match=r"GradientSolver.__init__\(\) missing 1 required positional argument: 'n_steps'"):
        GradientSolver(Sum())


@pytest.mark.parametrize("kind", CLASSES)
def test_copies_have_the_same_settings(kind):
    solver = made(kind, seed=7)
    for other in (pickle.loads(pickle.dumps(solver)), copy.deepcopy(solver), replace(solver)):
        assert repr(other) == repr(solver) and other.seed == 7
    assert replace(solver, num_samples=40).settings()["samples"] == 40
    assert solver != replace(solver) and len({solver, solver}) == 1, "solvers are equal by identity"


def test_icem_returns_its_mean_or_the_best():
    assert ICEMSolver(Sum()).settings()["return_best"] is False
    solver = ICEMSolver(Sum(), return_mean=False)
    assert solver.settings()["return_best"] is True
    solver.return_mean = True
    assert solver.settings()["return_best"] is False


def test_classes_of_ones_own():
    @dataclass(eq=False, repr=False)
    class Wide(CEMSolver):
        sigma_max: float = 3.0

    assert Wide(Sum(), num_samples=64).sigma_max == 3.0
    with pytest.raises(PlanError, match="setting `topk`: 30 of 16 samples"):
        Wide(Sum(), num_samples=16)

    class Shown(CEMSolver):
        """Has no constructor of its own."""

    class Small(Shown):
        def __init__(self, cost, **arguments):
            super().__init__(cost, num_samples=16, **arguments)
            self.topk = 4

    assert Small(Sum(), n_steps=2).settings()["elites"] == 4
    plan = configured(Small(Sum(), n_steps=2, seed=3)).solve(info())["actions"]
    np.testing.assert_array_equal(plan, configured(CEMSolver(Sum(), num_samples=16, topk=4, n_steps=2, seed=3)).solve(info())["actions"])


def test_names_of_settings_without_another_keyword():
    assert setting_of("clip") == "clip" and setting_of("topk") == "elites"


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_settings_that_are_not_finite_are_named(value: float) -> None:
    with pytest.raises(ValueError, match=f"var_scale={value}: a number is NaN or infinite; give a finite one"):
        CEMSolver(Sum(), var_scale=value)
