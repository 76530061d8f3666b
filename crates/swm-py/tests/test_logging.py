"""Notes and warnings arrive at one logger, and nothing is printed: neither by Python nor by the core."""

from __future__ import annotations

import ast
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from data_makers import write

import stable_worldmodel_rs as swm

PACKAGE = Path(swm.__file__).parent
LOGGER = "stable_worldmodel_rs"
PROGRAM = """
import logging
import numpy as np
import stable_worldmodel_rs as swm

world = swm.World("swm/PushT-v1", num_envs=2, image_shape=(32, 32), max_episode_steps=4)
world.set_policy("random")
world.collect("a.h5", episodes=2, seed=0, progress=False)
world.collect("a.h5", episodes=1, seed=0, mode="append", progress=False)
world.evaluate(episodes=2, seed=0, progress=False, video="videos")
with swm.data.get_format("hdf5").open_writer("b.h5") as writer:
    writer.write_episode({"action": np.zeros((3, 2), np.float32)})
dataset = swm.data.load_dataset("a.h5", num_steps=2)
list(swm.data.Loader(dataset, batch_size=2))
swm.data.convert("a.h5", "c.mcap", dest_format="mcap", progress=False)
swm.replay("a.h5", progress=False)
swm.spaces.Dict({"a": swm.spaces.Discrete(2)}, sampling_order=[])
"""


def odd_file(folder: Path) -> Path:
    """A file with a column that is left out: complex numbers have no type in the core."""
    path = write(folder / "odd.h5")
    with h5py.File(path, "a") as file:
        rows = len(file["action"])
        file["spectrum"] = np.zeros(rows, np.complex64)
    return path


def test_columns_that_are_left_out_are_warnings(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = odd_file(tmp_path)
    with caplog.at_level(logging.DEBUG, logger=LOGGER):
        dataset: Any = swm.data.load_dataset(path)
    assert [name for name, _ in dataset.skipped] == ["spectrum"]
    (record,) = caplog.records
    assert (record.name, record.levelno) == (LOGGER, logging.WARNING)
    assert "odd.h5" in record.message and "`spectrum`" in record.message


def test_a_recording_is_a_note(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    world = swm.World("swm/PushT-v1", num_envs=1, add_pixels=False, max_episode_steps=3)
    world.set_policy("random")
    with caplog.at_level(logging.DEBUG, logger=LOGGER):
        world.collect(tmp_path / "a.h5", episodes=2, seed=0, progress=False)
        world.collect(tmp_path / "a.h5", episodes=1, seed=0, mode="append", progress=False)
    assert [record.levelno for record in caplog.records] == [logging.INFO] * 2
    assert caplog.messages[1].endswith("a.h5: 1 episodes recorded, it has 3")


def test_nothing_is_printed(tmp_path: Path, run_python: Callable[..., Any]) -> None:
    done = run_python(f"import os; os.chdir({str(tmp_path)!r})\n{PROGRAM}")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_program_chooses_where_events_go(tmp_path: Path, run_python: Callable[..., Any]) -> None:
    begun = f"import logging, os; os.chdir({str(tmp_path)!r}); logging.basicConfig(level='INFO', format='%(name)s %(levelname)s')\n"
    done = run_python(begun + PROGRAM)
    assert done.returncode == 0 and done.stdout == "", done.stderr
    lines = done.stderr.splitlines()
    assert f"{LOGGER} INFO" in lines and f"{LOGGER}.spaces WARNING" in lines
    assert all(line.startswith(LOGGER) for line in lines), lines


@pytest.mark.parametrize(
    "path",
    sorted(path for path in PACKAGE.rglob("*.py") if "_lib" not in path.parts),
    ids=lambda path: str(path.relative_to(PACKAGE)),
)
def test_no_file_prints_or_logs_elsewhere(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func)
        assert called not in ("print", "warnings.warn", "sys.stdout.write", "sys.stderr.write"), called
        if called.endswith("getLogger"):
            name = ast.unparse(node.args[0])
            assert name == "__name__" or name.strip("'").split(".")[0] == LOGGER, name


def test_a_world_notes_what_is_odd_of_a_policy(caplog: pytest.LogCaptureFixture) -> None:
    world = swm.World("swm/TwoRoom-v2", num_envs=1, add_pixels=False)
    world.set_policy("cem:samples=10,elites=9,iterations=1")
    assert "cem keeps 9 of 10 samples as elites" in caplog.text
    caplog.clear()
    world.set_policy("cem:samples=10,elites=2,iterations=1")
    world.set_policy("random")
    assert not caplog.records
