"""Importing the package: quick, without torch, and environments are registered all the same."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

import stable_worldmodel_rs as swm

Run = Callable[..., Any]

CPU_TIME = """
import time
before = time.process_time()
import stable_worldmodel_rs
print(time.process_time() - before)
"""


def test_import_is_quick(run_python: Run) -> None:
    # The best of some: other programs of the machine only ever add.
    times = [float(run_python(CPU_TIME).stdout) for _ in range(5)]
    assert min(times) <= 0.15, times


def test_import_leaves_torch_and_gymnasium_alone(run_python: Run) -> None:
    done = run_python(
        "import sys, stable_worldmodel_rs; print(sorted({'torch', 'gymnasium', 'tqdm'} & set(sys.modules)))"
    )
    assert done.stdout.strip() == "[]", done.stderr


@pytest.mark.parametrize(
    "imports",
    [
        "import stable_worldmodel_rs, gymnasium",
        "import gymnasium, stable_worldmodel_rs",
        "import stable_worldmodel_rs\nimport gymnasium.spaces\nimport gymnasium",
    ],
)
def test_environments_are_registered_in_any_order(run_python: Run, imports: str) -> None:
    done = run_python(
        f"{imports}\nprint(gymnasium.spec('swm/PushT-v1').entry_point, gymnasium.spec('swm_rs/TwoRoom-v2').id)"
    )
    assert done.stdout.split() == ["stable_worldmodel_rs.envs:Env", "swm_rs/TwoRoom-v2"], done.stderr


def test_an_id_that_is_taken_stays(run_python: Run) -> None:
    code = """
import gymnasium
gymnasium.register(id="swm/PushT-v1", entry_point="somewhere:Else")
import stable_worldmodel_rs
print(gymnasium.spec("swm/PushT-v1").entry_point, gymnasium.spec("swm_rs/PushT-v1").entry_point)
"""
    assert run_python(code).stdout.split() == ["somewhere:Else", "stable_worldmodel_rs.envs:Env"]


def test_gymnasium_loads_the_package_by_a_prefix(run_python: Run) -> None:
    done = run_python("import gymnasium\nprint(gymnasium.make('stable_worldmodel_rs:swm/PushT-v1').spec.id)")
    assert done.stdout.strip() == "swm/PushT-v1", done.stderr


def test_every_public_name_exists() -> None:
    for name in swm.__all__:
        assert getattr(swm, name) is not None
    assert set(swm.__all__) <= set(dir(swm))


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Wrold'"):
        swm.Wrold  # noqa: B018  # pyright: ignore[reportAttributeAccessIssue]


def test_the_script_runs_the_command(run_python: Run) -> None:
    run = "import sys; from stable_worldmodel_rs._cli import main; sys.exit(main({}))"
    listed = run_python(run.format(["envs"]))
    assert listed.returncode == 0 and "swm/PushT-v1" in listed.stdout, listed.stderr
    wrong = run_python(run.format(["envs", "swm/Nowhere-v0"]))
    assert wrong.returncode != 0 and "swm/Nowhere-v0" in wrong.stderr
    # Who has the package may have no command `swm`.
    assert "`swm-rs envs` lists them" in wrong.stderr, wrong.stderr
    assert "swm-rs collect swm/PushT-v1" in run_python(run.format(["collect", "--help"])).stdout
    usage = run_python(run.format(["no-such-command"]))
    assert usage.returncode == 2


def test_ctrl_c_ends_the_script(tmp_path: Any) -> None:
    import signal
    import subprocess
    import sys

    out = tmp_path / "long.h5"
    code = "import sys; from stable_worldmodel_rs._cli import main; sys.exit(main())"
    arguments = ["collect", "swm/PushT-v1", "--policy", "random", "--episodes", "1000000", "--out", str(out), "--quiet"]
    child = subprocess.Popen([sys.executable, "-c", code, *arguments], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not out.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert out.exists() and child.poll() is None
    child.send_signal(signal.SIGINT)
    _, error = child.communicate(timeout=30)
    assert child.returncode == 130, (child.returncode, error)
    assert "interrupted" in error


def test_an_installed_ogbench_must_be_the_right_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    from stable_worldmodel_rs import _files, _swm

    monkeypatch.setattr(_files, "version", lambda name: "1.3.0")
    with pytest.raises(_swm.EnvError, match="ogbench==1.2.2"):
        _files._package("1.2.2")
    for source, _, names in _files._OGBENCH_PARTS:
        (tmp_path / source).mkdir(parents=True)
        for name in names or ("cube.xml",):
            (tmp_path / source / name).write_text("<mujoco/>")
    with pytest.raises(_swm.EnvError, match="not those that were published"):
        _files._check(tmp_path)


def test_models_are_linked_and_follow_a_new_source(tmp_path: Any) -> None:
    from stable_worldmodel_rs import _files

    place = tmp_path / "cache" / "models"
    for name in ("first", "second"):
        source = tmp_path / name
        source.mkdir()
        (source / "a.xml").write_text(name)
        _files._link(source, place)
        _files._link(source, place)
        assert (place / "a.xml").read_text() == name
