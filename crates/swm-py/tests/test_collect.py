"""Recordings: files equal to the command's, and writers that are Python objects."""

from __future__ import annotations

import copy
import json
import pickle
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm
from stable_worldmodel_rs._progress import Progress
from stable_worldmodel_rs.world.policies import PolicyInfos

h5py = pytest.importorskip("h5py")
try:
    import torch
except ImportError:
    torch = None  # type: ignore[assignment]


def make(num_envs: int = 3, **kwargs: object) -> swm.World:
    kwargs.setdefault("max_episode_steps", 12)
    return swm.World("swm/PushT-v1", num_envs, image_shape=(32, 32), threads=1, **kwargs)


class Keeps:
    """A writer that keeps what it gets."""

    def __init__(self) -> None:
        self.episodes: list[dict[str, Any]] = []
        self.is_open = False

    def __enter__(self) -> Keeps:
        self.is_open = True
        return self

    def __exit__(self, *error: object) -> None:
        self.is_open = False

    def write_episodes(self, episodes: Iterable[dict[str, Any]]) -> None:
        assert self.is_open
        self.episodes.extend(episodes)


def columns(path: Path) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = item[()]

    with h5py.File(path) as file:
        file.visititems(visit)
    return found


def test_a_file_is_the_commands(tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.h5", tmp_path / "theirs.h5"
    world = make()
    world.set_policy("weak")
    report = world.collect(ours, episodes=4, seed=7, options={"variation": ["agent.color"]}, progress=False)
    assert report == {"path": str(ours), "episodes": 4, "total_episodes": 4, "steps": 52}
    done = subprocess.run(
        [sys.executable, "-m", "stable_worldmodel_rs", "collect", "swm/PushT-v1", "--policy", "weak", "--episodes", "4"]
        + ["--seed", "7", "--max-steps", "12", "--image-size", "32x32", "--vary", "agent.color", "--out", str(theirs)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert ours.read_bytes() == theirs.read_bytes()


def test_files_do_not_depend_on_the_number_of_environments(tmp_path: Path) -> None:
    class Spring:
        def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
            return (256 - infos["state"][:, 0, :2]) / 256

    for num_envs in (1, 4):
        world = make(num_envs)
        world.set_policy(Spring())
        world.collect(tmp_path / f"{num_envs}.h5", episodes=5, seed=1, progress=False)
    assert (tmp_path / "1.h5").read_bytes() == (tmp_path / "4.h5").read_bytes()


def test_python_writers_get_what_files_hold(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    for policy in ("weak", "sine"):
        world, writer = make(2), Keeps()
        world.set_policy(policy)
        world.collect(path, episodes=3, seed=2, mode="overwrite", progress=False)
        report = world.collect(writer=writer, episodes=3, seed=2, progress=False)
        assert report["episodes"] == len(writer.episodes) == 3 and report["steps"] == 39
        stored = columns(path)
        for name in ("state", "action", "pixels", "reward"):
            joined = np.concatenate([episode[name] for episode in writer.episodes])
            np.testing.assert_array_equal(joined, stored[name])
        assert np.isnan(writer.episodes[0]["action"][-1]).all(), "the last step has no action"
        assert writer.episodes[0]["pixels"].shape == (13, 32, 32, 3)


def test_python_writers_and_policies_work_together() -> None:
    class Constant:
        def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
            return np.full((2, 2), 0.5)

    ours, native = Keeps(), Keeps()
    world = make(2)
    world.set_policy(Constant())
    world.collect(writer=ours, episodes=3, seed=2, progress=False)
    world.set_policy("constant:0.5,0.5")
    world.collect(writer=native, episodes=3, seed=2, progress=False)
    for one, other in zip(ours.episodes, native.episodes, strict=True):
        assert list(one) == list(other)
        np.testing.assert_array_equal(one["state"], other["state"])


def test_writers_need_not_be_contexts_and_may_stop_early() -> None:
    class First:
        def write_episodes(self, episodes: Iterable[dict[str, Any]]) -> None:
            self.first = next(iter(episodes))

    world, writer = make(1), First()
    world.set_policy("random")
    world.collect(writer=writer, episodes=100_000, seed=0, progress=False)
    assert len(writer.first["state"]) == 13
    world.reset(seed=0)
    world.step(np.zeros((1, 2)))


def test_the_replay_buffer_is_a_writer() -> None:
    buffer = swm.data.ReplayBuffer(max_steps=200)
    world = make(2)
    world.set_policy("random")
    world.collect(writer=buffer, episodes=4, seed=0, progress=False)
    assert buffer.num_episodes == 4


def test_appended_episodes_are_those_of_one_run(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    world = make()
    world.set_policy("random")
    world.collect(tmp_path / "parts.h5", episodes=2, seed=5, progress=False)
    report = world.collect(tmp_path / "parts.h5", episodes=3, seed=5, mode="append", progress=False)
    assert report["total_episodes"] == 5
    world.collect(tmp_path / "whole.h5", episodes=5, seed=5, progress=False)
    parts, whole = columns(tmp_path / "parts.h5"), columns(tmp_path / "whole.h5")
    np.testing.assert_array_equal(parts["state"], whole["state"])
    assert not caplog.messages
    world.collect(tmp_path / "parts.h5", episodes=1, seed=6, mode="append", progress=False)
    assert "appended to it, though its episodes are of another recording: seed 5, not 6" in caplog.text
    with pytest.raises(swm.SwmError, match="exist"):
        world.collect(tmp_path / "whole.h5", episodes=1, seed=5, progress=False)


def test_what_is_no_longer_sampled_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    world = make()
    world.set_policy("random")
    world.collect(tmp_path / "a.h5", 2, seed=1, options={"variation": ["agent.color"]}, progress=False)
    told = caplog.text
    assert "samples only what it names; " in told and "block.start_position" in told
    assert np.ptp(columns(tmp_path / "a.h5")["variation.agent.color"], axis=0).any()
    caplog.clear()
    world.evaluate(2, seed=1, options={"variation": ["agent.color"]})
    assert "samples only what it names; " in caplog.text
    caplog.clear()
    starts = {"agent.start_position": [100.0, 100.0]}
    for options in [None, {"variation": ["default", "agent.color"]}, {"variation": []}, {"variation_values": starts}]:
        world.collect(tmp_path / "b.h5", 2, seed=1, options=options, mode="overwrite", progress=False)
    swm.make_manifest(tmp_path / "a.toml", "swm/PushT-v1", 2, variation=["default", "agent.color"])
    assert not caplog.messages
    swm.make_manifest(tmp_path / "b.toml", "swm/PushT-v1", 2, variation=["agent.color"], variation_values=starts)
    assert "block.start_position" in caplog.text and "agent.start_position" not in caplog.text


def test_formats_are_chosen_by_name_and_suffix(tmp_path: Path) -> None:
    world = make(1)
    world.set_policy("random")
    world.collect(tmp_path / "plain", episodes=1, seed=0, progress=False)
    assert h5py.is_hdf5(tmp_path / "plain")
    world.collect(tmp_path / "images", episodes=1, seed=0, format="folder", progress=False)
    assert (tmp_path / "images").is_dir()
    with pytest.raises(ValueError, match="hdf5"):
        world.collect(tmp_path / "x.unknown", episodes=1, seed=0, progress=False)


def test_replayable_files_render_their_images_when_read(tmp_path: Path) -> None:
    world = make(2)
    world.set_policy("random")
    world.collect(tmp_path / "states.h5", episodes=2, seed=0, replayable=4, progress=False)
    assert "pixels" not in columns(tmp_path / "states.h5") and "checkpoint" in columns(tmp_path / "states.h5")
    world.collect(tmp_path / "true.h5", episodes=1, seed=0, replayable=True, progress=False)
    world.collect(tmp_path / "false.h5", episodes=1, seed=0, replayable=False, progress=False)
    runs = [json.loads(_swm.Reader.open(str(tmp_path / name), None, None).runs)[0][1] for name in ("true.h5", "false.h5")]
    assert [run.get("checkpoints") for run in runs] == [16, None]
    with pytest.raises(swm.SwmError, match="every 0 steps is not in 1 to"):
        world.collect(tmp_path / "zero.h5", episodes=1, seed=0, replayable=0, progress=False)
    world.set_policy(type("P", (), {"get_action": lambda self, infos: None})())
    with pytest.raises(TypeError, match="replayable"):
        world.collect(tmp_path / "b.h5", episodes=2, seed=0, replayable=4, progress=False)
    gym = swm.World("CartPole-v1", num_envs=1, add_pixels=False)
    gym.set_policy("random")
    with pytest.raises(TypeError, match="replayable= records states of environments of this package"):
        gym.collect(tmp_path / "c.h5", episodes=1, seed=0, replayable=4, progress=False)


def test_what_is_asked_for_wrongly_is_refused(tmp_path: Path) -> None:
    world = make(1)
    world.set_policy("random")
    with pytest.raises(ValueError, match="exactly one of `path` or `writer`"):
        world.collect(episodes=1)
    with pytest.raises(ValueError, match="1 or more"):
        world.collect(tmp_path / "a.h5", episodes=0)
    with pytest.raises(swm.SwmError, match="there are `append`, `overwrite`, `error`"):
        world.collect(tmp_path / "a.h5", episodes=1, mode="both", progress=False)
    unrecorded = make(1, unrecorded=["goal"])
    unrecorded.set_policy("random")
    unrecorded.collect(tmp_path / "b.h5", episodes=1, seed=0, progress=False)
    assert "goal" not in columns(tmp_path / "b.h5")


def test_a_bar_shows_progress(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    pytest.importorskip("tqdm")
    world = make(1)
    world.set_policy("random")
    world.collect(tmp_path / "a.h5", episodes=3, seed=0)
    assert "3/3" in capsys.readouterr().err
    world.collect(tmp_path / "b.h5", episodes=3, seed=0, progress=False)
    captured = capsys.readouterr()
    assert captured.err == "" and captured.out == ""


def test_a_bar_in_a_file_is_a_line_for_what_is_new(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("tqdm")
    log = tmp_path / "log"
    with log.open("w") as file:
        monkeypatch.setattr("sys.stderr", file)
        with Progress("Recording", total=8) as bar:
            for done in (0, 0, 0, 1, 1, 2):
                time.sleep(0.15)
                bar.tick(done, 0, 0)
    lines = re.split("[\\r\\n]+", log.read_text().strip())
    assert len(lines) == 2 and "0/8" in lines[0] and "2/8" in lines[1], lines


def in_place(infos: dict[str, Any]) -> Any:
    """Scales every column of the infos in place, by NumPy, and one by torch, as programs normalize observations."""
    for values in infos.values():
        if isinstance(values, np.ndarray):
            values[...] = 0
    if torch is not None:
        torch.as_tensor(infos["pixels"]).fill_(7)
    infos["state"] = None
    infos["new"] = np.ones(3)
    return np.full((3, 2), 0.1, np.float32)


def constant(infos: dict[str, Any]) -> Any:
    assert "new" not in infos and infos["state"] is not None
    return np.full((3, 2), 0.1, np.float32)


def blacken(image: np.ndarray) -> np.ndarray:
    image[...] = 0
    return image


def test_a_policy_that_changes_its_infos_changes_nothing_of_the_recording(tmp_path: Path) -> None:
    recorded = {}
    for name, policy, transform in (("plain", constant, None), ("in_place", in_place, None), ("transform", constant, blacken)):
        world = make(image_transform=transform)
        world.set_policy(policy)
        world.collect(tmp_path / f"{name}.h5", episodes=4, seed=3, progress=False)
        recorded[name] = columns(tmp_path / f"{name}.h5")
        buffer = Keeps()
        world.collect(writer=buffer, episodes=4, seed=3, progress=False)
        recorded[f"{name} by a writer"] = {
            column: np.concatenate([np.asarray(episode[column]) for episode in buffer.episodes]) for column in ("state", "pixels", "action")
        }
    plain = recorded["plain"]
    assert len(np.unique(plain["state"], axis=0)) > 20 and plain["pixels"].any()
    for name, found in recorded.items():
        for column, values in found.items():
            if column in plain and column != "policy":
                np.testing.assert_array_equal(values, plain[column], err_msg=f"{name}: {column}")
    assert swm.replay(tmp_path / "in_place.h5", progress=False)["ok"]


def test_a_recording_is_checked_by_a_replay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world = make()
    world.set_policy(in_place)
    path = tmp_path / "a.h5"
    world.collect(path, episodes=2, seed=3, progress=False, check=True)
    world.collect(path, episodes=2, seed=3, mode="append", progress=False, check=True)
    replayed: list[Any] = []

    def differs(path: Path, episodes: Any, **options: Any) -> dict[str, Any]:
        replayed.append(list(episodes))
        return {"ok": False}

    monkeypatch.setattr("stable_worldmodel_rs.world.requests.replay", differs)
    with pytest.raises(swm.DataError, match="a replay of the new episodes differs"):
        world.collect(path, episodes=3, seed=3, mode="append", progress=False, check=True)
    assert replayed == [[4, 5, 6]]
    with pytest.raises(TypeError, match="check=True"):
        world.collect(writer=Keeps(), episodes=1, check=True)


def test_infos_of_policies_are_dicts_whose_columns_are_their_own() -> None:
    shown = {"state": np.arange(3.0), "pixels": np.zeros(4, np.uint8), "name": [["a"]]}
    for values in shown.values():
        if isinstance(values, np.ndarray):
            values.setflags(write=False)

    def made() -> Any:
        return PolicyInfos(shown)

    reads: list[Any] = [
        lambda infos: infos["state"],
        lambda infos: infos.get("state"),
        lambda infos: infos.pop("state"),
        lambda infos: dict(infos)["state"],
        lambda infos: {**infos}["state"],
        lambda infos: infos.copy()["state"],
        lambda infos: dict(infos.items())["state"],
        lambda infos: next(iter(infos.values())),
        lambda infos: copy.deepcopy(infos)["state"],
        lambda infos: pickle.loads(pickle.dumps(infos))["state"],
    ]
    for number, read in enumerate(reads):
        state = read(made())
        state += 1
        assert state.tolist() == [1, 2, 3] and shown["state"].tolist() == [0, 1, 2], number
    infos = made()
    assert infos["state"] is infos["state"], "a change stays for the rest of the step"
    infos["name"][0][0] = "b"
    infos["new"] = 1
    assert shown["name"] == [["a"]] and "new" not in shown and isinstance(infos, dict) and len(infos) == 4
    assert infos.get("none", 5) == infos.pop("none", 5) == 5 and list(infos) == ["state", "pixels", "name", "new"]
    with pytest.raises(KeyError):
        infos.pop("none")


def test_what_a_policy_was_given_is_its_own() -> None:
    kept: list[np.ndarray] = []

    def keeps(infos: dict[str, Any]) -> Any:
        kept.append(infos["state"])
        return np.full((3, 2), 0.1, np.float32)

    world = make()
    world.set_policy(keeps)
    world.reset(seed=0)
    for _ in range(4):
        world.step()
    assert len({state.tobytes() for state in kept}) == 4, "frames that are kept differ"


def test_an_append_holds_the_factors_that_the_file_holds(tmp_path: Path) -> None:
    path, varied = tmp_path / "a.h5", {"variation": ["default", "agent.color"]}
    for policy in ("random", constant):
        world = make()
        world.set_policy(policy)
        world.collect(path, episodes=2, seed=1, options=varied, mode="overwrite", progress=False)
        report = world.collect(path, episodes=3, seed=1, mode="append", progress=False)
        assert report["total_episodes"] == 5
        found = columns(path)
        color = found["variation.agent.color"][found["ep_offset"]]
        assert len(color) == 5 and (color[2:] == color[2]).all() and (color[:2] != color[2]).any()
    world.collect(writer=swm.data.HDF5Writer(path, mode="append"), episodes=1, seed=4, progress=False)
    assert len(swm.data.load_dataset(path).lengths) == 6


def test_a_total_continues_a_recording_to_the_same_episodes(tmp_path: Path) -> None:
    world = make(2)
    world.set_policy("random")
    whole, grown = tmp_path / "whole.h5", tmp_path / "grown.h5"
    world.collect(whole, episodes=5, seed=2, progress=False)
    world.collect(grown, episodes=2, seed=2, progress=False)
    written = world.collect(grown, total=5, seed=2, mode="append", progress=False)
    assert (written["episodes"], written["total_episodes"]) == (3, 5)
    for name, values in columns(whole).items():
        np.testing.assert_array_equal(columns(grown)[name], values)
