"""Jobs of many machines from the package: its tasks run the interpreter, not a copy of it."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import stable_worldmodel_rs as swm

from conftest import ROOT

SWM = [sys.executable, "-m", "stable_worldmodel_rs"]
COLLECT = ["collect", "swm/TwoRoom-v2", "--policy", "expert", "--episodes", "4", "--seed", "1", "--image-size", "none"]


def run(words: list[str], folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs a command in a folder; modules are found there only as Python finds them for this process."""
    paths = os.pathsep.join(os.path.abspath(path) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path)
    variables = {**os.environ, "PYTHONPATH": paths, **environment}
    return subprocess.run(words, cwd=folder, env=variables, capture_output=True, text=True, timeout=300)


def submitted(folder: Path) -> list[list[str]]:
    """The commands of the tasks of a job of 2 shards, as `--on script` prints them."""
    done = run([*SWM, "submit", "--on", "script", "--shards", "2", "--job", "rooms", "--", *COLLECT], folder)
    assert done.returncode == 0, done.stderr
    return [shlex.split(line) for line in done.stdout.splitlines()]


def test_a_job_of_the_package_runs_its_interpreter(tmp_path: Path) -> None:
    tasks = submitted(tmp_path)
    assert [task[-2:] for task in tasks[:2]] == [["--index", "1"], ["--index", "2"]] and tasks[2][-1] == "--finish"
    assert all(task[0] == sys.executable for task in tasks)
    job = json.loads((tmp_path / "rooms/job.json").read_text())
    assert job["program"]["package"]["install"] == f"stable-worldmodel-rs=={swm.__version__}"
    assert not (tmp_path / "rooms/swm").exists()
    shadow = tmp_path / "json.py"
    if sys.version_info >= (3, 11):
        # A file of the folder that is called as a module of Python's own does not get in the way.
        shadow.write_text("raise RuntimeError('not the module of Python')\n")
    # As an array of Slurm runs them: each by itself, the number in the environment.
    for number, task in enumerate(tasks[:2], 1):
        assert (done := run(task[:-2], tmp_path, SLURM_ARRAY_TASK_ID=str(number))).returncode == 0, done.stderr
    assert (done := run(tasks[2], tmp_path)).returncode == 0, done.stderr
    shadow.unlink(missing_ok=True)
    assert (done := run([*SWM, *COLLECT, "--out", "whole.h5"], tmp_path)).returncode == 0, done.stderr
    assert (tmp_path / "rooms/result.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()


def test_the_first_lines_of_the_page_run_from_the_package(tmp_path: Path) -> None:
    page = (ROOT / "docs/many-machines.md").read_text()
    lines = page.split("```sh\n", 1)[1].split("```", 1)[0].replace("\\\n", " ").splitlines()
    assert [line.split()[:2] for line in lines] == [["swm", "submit"], ["swm", "jobs"], ["swm", "submit"]]
    # Without a cluster, and in small.
    fewer = re.sub(r"--on slurm\S*", "--on script", lines[0]).replace("--shards 64", "--shards 2").replace("100000", "4")
    submit, jobs, again = ([*SWM, *shlex.split(line, comments=True)[1:]] for line in (fewer, *lines[1:]))
    printed = run(submit, tmp_path)
    assert printed.returncode == 0, printed.stderr
    for task in printed.stdout.splitlines():
        assert (done := run(shlex.split(task), tmp_path)).returncode == 0, done.stderr
    assert "pusht/result.h5 (" in (shown := run(jobs, tmp_path)).stdout, shown
    assert "nothing to submit" in (done := run(again, tmp_path)).stdout, done
    assert len(swm.data.load_dataset(tmp_path / "pusht/result.h5").lengths) == 4


def test_a_changed_installation_is_named_before_a_task_runs(tmp_path: Path) -> None:
    tasks = submitted(tmp_path)
    path = tmp_path / "rooms/job.json"
    job: dict[str, Any] = json.loads(path.read_text())
    job["program"]["sha256"] = "0" * 64
    job["program"]["package"]["install"] = "stable-worldmodel-rs==0.0.1"
    path.write_text(json.dumps(job))
    done = run(tasks[0], tmp_path)
    assert done.returncode == 2, done.stdout
    assert "the package has changed since the job" in done.stderr and "pip install stable-worldmodel-rs==0.0.1" in done.stderr
    assert f"here is stable-worldmodel-rs=={swm.__version__}" in done.stderr
    assert not list((tmp_path / "rooms/parts").iterdir())


def test_the_program_and_the_package_do_not_run_each_others_tasks(tmp_path: Path, command: str) -> None:
    tasks = submitted(tmp_path)
    done = run([command, *tasks[0][tasks[0].index("task") :]], tmp_path)
    assert done.returncode == 2 and f"run the tasks with {sys.executable}" in done.stderr, done.stderr
    shutil.rmtree(tmp_path / "rooms")
    done = run([command, "submit", "--on", "script", "--shards", "2", "--job", "rooms", "--", *COLLECT], tmp_path)
    assert done.returncode == 0 and shlex.split(done.stdout.splitlines()[0])[0] == str(tmp_path / "rooms/swm"), done.stderr
    done = run([*SWM, "task", "rooms", "--index", "1"], tmp_path)
    assert done.returncode == 2 and "rooms/swm" in done.stderr, done.stderr
