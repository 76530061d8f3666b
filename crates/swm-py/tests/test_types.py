"""What type checkers see: the stub is that of the compiled module, programs are checked against real types, and the package
is clean under the strict rules of pyright.

Where torch is not installed, ``typings/torch`` stands in for it: it has the kinds that the package names.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import stable_worldmodel_rs as swm

PACKAGE = Path(swm.__file__).parent
TYPINGS = Path(__file__).parent / "typings"
needs_mypy = pytest.mark.skipif(find_spec("mypy") is None, reason="mypy is not installed")
needs_pyright = pytest.mark.skipif(find_spec("basedpyright") is None, reason="basedpyright is not installed")

PROGRAM = """
import numpy as np
import stable_worldmodel_rs as swm

world = swm.World("swm/PushT-v1", num_envs=2, image_shape=(64, 64))
world.set_policy("expert")
result = world.evaluate(episodes=2, seed=0)
reveal_type(world)
reveal_type(result)
reveal_type(world.rewards)
dataset = swm.data.load_dataset("a.h5", num_steps=4)
reveal_type(swm.data.Loader(dataset, batch_size=8))
solver = swm.planning.CEMSolver(object(), num_samples=10)
config = swm.PlanConfig(horizon=5, receding_horizon=5)
reveal_type(swm.WorldModelPolicy(solver, config))
reveal_type(swm.evaluate("task.toml", "expert").success_rate)
try:
    world.reset(seed=1)
except swm.EnvError as error:
    reveal_type(error)
"""
SEEN = [
    "world.world.World",
    "world.results.EvaluationResult",
    "ndarray[",
    "data.loader.Loader",
    "policy.WorldModelPolicy",
    "float",
    "_swm.EnvError",
]


def run(*arguments: str, folder: Path) -> tuple[int, str]:
    env = dict(os.environ)
    home = Path(swm.__file__).parent.parent
    if home.name != "site-packages":
        # It is not installed, and mypy does not look at PYTHONPATH.
        env["MYPYPATH"] = env["PYTHONPATH"] = str(home)
    done = subprocess.run([sys.executable, "-m", *arguments], cwd=folder, env=env, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


@needs_mypy
def test_the_stub_is_that_of_the_compiled_module(tmp_path: Path) -> None:
    # Of the rest of the package, only what the stub imports counts.
    config = tmp_path / "mypy.ini"
    config.write_text("[mypy]\nfollow_imports = silent\n")
    code, said = run("mypy.stubtest", "stable_worldmodel_rs._swm", "--mypy-config-file", str(config), folder=tmp_path)
    assert code == 0, said


@needs_mypy
def test_programs_are_checked_against_real_types(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    code, said = run("mypy", "--strict", "--follow-imports=silent", str(program), folder=tmp_path)
    assert code == 0, said
    revealed = [line for line in said.splitlines() if "Revealed type" in line]
    assert len(revealed) == len(SEEN), said
    for line, name in zip(revealed, SEEN):
        assert name in line, line


@needs_mypy
def test_wrong_programs_are_found(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text('import stable_worldmodel_rs as swm\nswm.World("swm/PushT-v1", number=2).evalute(1)\nswm.Wrold\n')
    code, said = run("mypy", "--strict", "--follow-imports=silent", str(program), folder=tmp_path)
    assert code == 1
    assert "evalute" in said and "Wrold" in said, said


def pyright(*arguments: str, folder: Path) -> dict[str, Any]:
    """What basedpyright reports; it looks at the search path of the first `python` in PATH."""
    paths = [] if find_spec("torch") is not None else [str(TYPINGS)]
    if PACKAGE.parent.name != "site-packages":
        paths.append(str(PACKAGE.parent))
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    env["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    command = [sys.executable, "-m", "basedpyright", "--outputjson", *arguments]
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True)
    try:
        report: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        pytest.fail(done.stdout + done.stderr)
    return report


@needs_pyright
def test_the_package_is_clean_under_strict_rules(tmp_path: Path) -> None:
    rules = {"typeCheckingMode": "strict", "include": [str(PACKAGE)], "exclude": []}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(rules))
    report = pyright("--project", str(tmp_path), folder=tmp_path)
    found = [
        f"{one['file']}:{one['range']['start']['line'] + 1}: {one['message']} ({one.get('rule')})"
        for one in report["generalDiagnostics"]
        # The compiled module and what stands in for torch have stubs, and no source.
        if one.get("rule") != "reportMissingModuleSource"
    ]
    assert not found, "\n".join(found)
    assert report["summary"]["filesAnalyzed"] >= len([path for path in PACKAGE.rglob("*.py") if "_lib" not in path.parts])


@needs_pyright
def test_every_public_name_has_a_known_type(tmp_path: Path) -> None:
    # Types that numpy and gymnasium leave unknown are theirs.
    report = pyright("--verifytypes", "stable_worldmodel_rs", "--ignoreexternal", folder=tmp_path)["typeCompleteness"]
    lacking = [symbol["name"] for symbol in report["symbols"] if symbol["isExported"] and not symbol["isTypeKnown"]]
    assert report["completenessScore"] == 1, lacking
    assert report["exportedSymbolCounts"]["withKnownType"] > 900


@needs_pyright
def test_strict_rules_find_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text("import stable_worldmodel_rs as swm\nswm.World('swm/PushT-v1').rewards.sort_by(1)\n")
    report = pyright(str(tmp_path / "program.py"), folder=tmp_path)
    assert any("sort_by" in one["message"] for one in report["generalDiagnostics"]), report
