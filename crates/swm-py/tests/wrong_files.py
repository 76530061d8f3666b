"""Wrong inputs of a first week, to the command and in files of one's own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np


class Refused(Exception):
    """The command ended with another status than 0; the text is what it wrote."""


def run(folder: Path, *arguments: str) -> str:
    """What the command writes where it succeeds: notes are on either stream."""
    command = os.environ.get("SWM_COMMAND") or shutil.which("swm")
    assert command is not None, "the program `swm` was not found; set SWM_COMMAND to target/debug/swm"
    done = subprocess.run([command, *arguments], cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    if done.returncode != 0:
        raise Refused(f"{done.stderr}{done.stdout}")
    return done.stderr + done.stdout


def pusht(folder: Path, *more: str) -> None:
    run(folder, "collect", "swm/PushT-v1", "--episodes", "2", "--max-steps", "8", "--image-size", "32x32", "--out", "a.h5", "--quiet", *more)


def own(folder: Path, **changes: Any) -> None:
    """A file of two episodes of five rows, written by h5py."""
    columns: dict[str, Any] = {
        "pixels": np.zeros((10, 32, 32, 3), np.uint8),
        "state": np.linspace(0, 1, 30).reshape(10, 3),
        "action": np.linspace(-1, 1, 20, dtype=np.float32).reshape(10, 2),
        "ep_len": np.array([5, 5]),
        "ep_offset": np.array([0, 5]),
        **changes,
    }
    with h5py.File(folder / "a.h5", "w") as file:
        for name, values in columns.items():
            if values is not None:
                file[name] = values


def elites_above_samples(folder: Path) -> str:
    return run(folder, "eval", "swm/PushT-v1", "--policy", "cem:samples=10,elites=20", "--episodes", "1", "--budget", "2")


def no_goal_offset(folder: Path) -> str:
    pusht(folder)
    return run(folder, "eval", "swm/PushT-v1", "--policy", "random", "--dataset", "a.h5", "--goal-offset", "0", "--budget", "2", "--episodes", "1")


def no_budget(folder: Path) -> str:
    return run(folder, "eval", "swm/PushT-v1", "--policy", "random", "--episodes", "1", "--budget", "0")


def copy_onto_itself(folder: Path) -> str:
    pusht(folder)
    return run(folder, "convert", "a.h5", "a.h5")


def the_same_file_twice(folder: Path) -> str:
    pusht(folder)
    return run(folder, "merge", "a.h5", "a.h5", "--out", "b.h5")


def parts_above_one(folder: Path) -> str:
    pusht(folder)
    return run(folder, "split", "a.h5", "--parts", "train=0.9,val=0.9", "--out", "b_{}.h5")


def unknown_column_of_statistics(folder: Path) -> str:
    pusht(folder)
    return run(folder, "stats", "a.h5", "--columns", "actions")


def file_without_h5_inside(folder: Path) -> str:
    (folder / "a.h5").write_text("state,action\n0,1\n")
    return run(folder, "inspect", "a.h5")


def manifest_changed_by_hand(folder: Path) -> str:
    run(folder, "manifest", "make", "swm/PushT-v1", "--tier", "historic", "--episodes", "2", "--out", "task.toml", "--quiet")
    text = (folder / "task.toml").read_text()
    (folder / "task.toml").write_text(text.replace("budget = 200", "budget = 20"))
    return run(folder, "eval", "--manifest", "task.toml", "--policy", "random", "--reference", "no-op")


def actions_one_row_short(folder: Path) -> str:
    own(folder, action=np.zeros((9, 2), np.float32))
    return run(folder, "verify", "a.h5")


def lengths_short_of_the_rows(folder: Path) -> str:
    own(folder, ep_len=np.array([5, 3]))
    return run(folder, "verify", "a.h5")


def episodes_that_overlap(folder: Path) -> str:
    own(folder, ep_len=np.array([5, 7]), ep_offset=np.array([0, 3]))
    return run(folder, "verify", "a.h5")


def images_channels_first(folder: Path) -> str:
    own(folder, pixels=np.zeros((10, 3, 32, 32), np.uint8))
    return run(folder, "verify", "a.h5")


def images_of_floats(folder: Path) -> str:
    own(folder, pixels=np.random.default_rng(0).random((10, 32, 32, 3), np.float32))
    return run(folder, "verify", "a.h5")


def nan_within_an_episode(folder: Path) -> str:
    action = np.zeros((10, 2), np.float32)
    action[2] = np.nan
    own(folder, action=action)
    return run(folder, "verify", "a.h5")


def infinite_state(folder: Path) -> str:
    state = np.zeros((10, 3))
    state[2, 1] = np.inf
    own(folder, state=state)
    return run(folder, "verify", "a.h5")


def no_lengths(folder: Path) -> str:
    own(folder, ep_len=None, ep_offset=None)
    return run(folder, "inspect", "a.h5")


def replay_of_a_foreign_file(folder: Path) -> str:
    own(folder)
    return run(folder, "replay", "a.h5")


def edited_receipt(folder: Path) -> str:
    run(folder, "manifest", "make", "swm/PushT-v1", "--tier", "historic", "--episodes", "2", "--budget", "4", "--seed", "1", "--out", "task.toml")
    run(folder, "eval", "--manifest", "task.toml", "--policy", "random", "--out", "result", "--quiet")
    path = folder / "result/receipt.json"
    receipt = json.loads(path.read_text())
    receipt["summary"]["success_rate"] = 99.0
    path.write_text(json.dumps(receipt))
    return run(folder, "compare", "result", "result")


def preview_without_images(folder: Path) -> str:
    own(folder, pixels=None)
    return run(folder, "preview", "a.h5", "--out", "a.png")


INPUTS: list[tuple[Callable[[Path], Any], list[str]]] = [
    (elites_above_samples, ["`elites`: 20 of 10 samples"]),
    (no_goal_offset, ["--goal-offset 0: every start would be its goal"]),
    (no_budget, ["--budget 0: no action is allowed; use 1 or more"]),
    (copy_onto_itself, ["a.h5 is the dataset to read and the one to write"]),
    (the_same_file_twice, ["a.h5 is named twice"]),
    (parts_above_one, ["--parts: they sum to 1.8"]),
    (unknown_column_of_statistics, ["no column `actions` (did you mean `action`?)"]),
    (file_without_h5_inside, ["a.h5 is not a dataset", "cut short or another file"]),
    (manifest_changed_by_hand, ["task.toml", "was changed after it was written"]),
    (actions_one_row_short, ["column `action` has 9"]),
    (lengths_short_of_the_rows, ["no episode of `ep_offset` and `ep_len` has rows 8 to 9 of 10"]),
    (episodes_that_overlap, ["episodes 0 and 1 both have rows 3 to 4"]),
    (images_channels_first, ["column `pixels` is uint8 of shape [3, 32, 32]", "images are uint8 of shape [H, W, 3]"]),
    (images_of_floats, ["column `pixels` is float32 of shape [32, 32, 3]", "images are uint8 of shape [H, W, 3]"]),
    (nan_within_an_episode, ["column `action`: row 2 holds NaN"]),
    (infinite_state, ["column `state`: row 2 holds an infinite number"]),
    (no_lengths, ["it has no `ep_len`, which says where episodes lie"]),
    (edited_receipt, ["result: the summary is not that of the episodes", "evaluate again"]),
    (preview_without_images, ["a.h5 holds no images", "its columns: action, state"]),
    (replay_of_a_foreign_file, ["a.h5 does not name its environment"]),
]
