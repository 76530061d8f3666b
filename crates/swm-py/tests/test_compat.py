"""`compat`: the package under the reference's name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

Run = Callable[..., Any]
INSTALL = "import stable_worldmodel_rs as ours\nfrom stable_worldmodel_rs import compat\ncompat.install()\n"


def lines(done: Any) -> list[str]:
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_modules_and_classes_are_the_same_objects(run_python: Run) -> None:
    code = f"""{INSTALL}
import stable_worldmodel as swm
import stable_worldmodel.spaces, stable_worldmodel.planning.solver.cem
from stable_worldmodel.policy import WorldModelPolicy
from stable_worldmodel.world.env_pool import EnvPool
import stable_worldmodel_rs.planning.solver.cem as cem
print(swm.World is ours.World, stable_worldmodel.spaces is ours.spaces, WorldModelPolicy is ours.WorldModelPolicy)
print(EnvPool is ours.EnvPool, stable_worldmodel.planning.solver.cem is cem, cem.__spec__.name)
"""
    assert lines(run_python(code)) == ["True"] * 5 + ["stable_worldmodel_rs.planning.solver.cem"]


def test_paths_of_configurations_resolve(run_python: Run) -> None:
    # As Hydra does: import the longest prefix that is a module, then take attributes.
    code = f"""{INSTALL}
from importlib import import_module
for path in ["stable_worldmodel.planning.solver.cem.CEMSolver", "stable_worldmodel.policy.PlanConfig",
             "stable_worldmodel.data.formats.hdf5.HDF5Dataset", "stable_worldmodel.spaces.Box"]:
    module, _, name = path.rpartition(".")
    print(getattr(import_module(module), name).__module__.split(".")[0])
"""
    assert set(lines(run_python(code))) == {"stable_worldmodel_rs"}


def test_stand_ins_of_costs_are_refused_when_they_are_asked(run_python: Run) -> None:
    code = """{}
from stable_worldmodel_rs.planning.solver import CEMSolver
class StandIn: pass
try:
    print(CEMSolver(StandIn(), num_samples=8, topk=4).num_samples)
except TypeError as error:
    print("refused" if "has no get_cost" in str(error) else error)
"""
    assert lines(run_python(code.format(INSTALL))) == ["8"]
    assert lines(run_python(code.format(""))) == ["refused"]


def test_what_is_missing_comes_from_an_installed_reference(run_python: Run, tmp_path: Any) -> None:
    theirs = tmp_path / "stable_worldmodel"
    (theirs / "plots").mkdir(parents=True)
    (theirs / "__init__.py").write_text("raise RuntimeError('the facade takes its place')")
    (theirs / "spaces.py").write_text("raise RuntimeError('ours goes first')")
    (theirs / "envs" / "grid").mkdir(parents=True)
    (theirs / "envs" / "grid" / "env.py").write_text("from stable_worldmodel import spaces\nBOX = spaces.Box\n")
    (theirs / "plots" / "__init__.py").write_text("import stable_worldmodel as swm\nPOLICY = swm.PlanConfig\n")
    # In front of a reference that is installed.
    code = f"""import sys; sys.path.insert(0, {str(tmp_path)!r})
{INSTALL}
import stable_worldmodel as swm
import stable_worldmodel.spaces
from stable_worldmodel.envs.grid.env import BOX
print(swm.plots.POLICY is ours.PlanConfig, BOX is ours.spaces.Box)
"""
    assert lines(run_python(code)) == ["True", "True"]


def test_what_nobody_has_is_named(run_python: Run) -> None:
    done = run_python(f"{INSTALL}\nimport stable_worldmodel as swm\nswm.pretraining_of_models")
    assert "AttributeError" in done.stderr and "docs/migration.md" in done.stderr
    done = run_python(f"{INSTALL}\nimport stable_worldmodel.nothing")
    assert "ModuleNotFoundError: No module named 'stable_worldmodel.nothing'" in done.stderr


def test_the_reference_may_not_have_been_imported_before(run_python: Run, tmp_path: Any) -> None:
    (tmp_path / "stable_worldmodel.py").write_text("NAME = 'theirs'")
    # In front of a reference that is installed.
    code = f"""import sys; sys.path.insert(0, {str(tmp_path)!r})
import stable_worldmodel
from stable_worldmodel_rs import compat
try:
    compat.install()
except ImportError as error:
    print("compat.install()" in str(error))
del sys.modules["stable_worldmodel"]
compat.install(); compat.install()
import stable_worldmodel as ours
print(hasattr(ours, "World"), compat.is_installed())
compat.uninstall()
import stable_worldmodel as theirs
print(theirs.NAME, compat.is_installed())
"""
    assert lines(run_python(code)) == ["True", "True", "True", "theirs", "False"]


def test_pytest_plugin(tmp_path: Any) -> None:
    import subprocess
    import sys

    test = tmp_path / "test_theirs.py"
    test.write_text(
        "import stable_worldmodel as swm\n\ndef test_it():\n    assert swm.World.__module__.startswith('stable_worldmodel_rs')\n"
    )
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "stable_worldmodel_rs.compat",
        "-p",
        "no:cacheprovider",
        str(test),
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", ["policy", "planning", "data", "spaces", "protocols", "world", "envs", "buffer"])
def test_top_level_names_are_lazy(run_python: Run, name: str) -> None:
    code = f"{INSTALL}\nimport stable_worldmodel as swm\nprint(swm.{name} is ours.{name})"
    assert lines(run_python(code)) == ["True"]
