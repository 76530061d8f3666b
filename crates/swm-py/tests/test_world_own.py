"""Environments as users write them: nested observations, texts, lists, and infos that come and go, all of it recorded or noted."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

import stable_worldmodel_rs as swm

h5py = pytest.importorskip("h5py")

VECTOR = spaces.Box(-99, 99, (2,), np.float64)


def vector(step: int) -> Any:
    return np.array([step, -step], np.float64)


def own(
    length: int = 3,
    observe: Callable[[int], Any] = vector,
    inform: Callable[[int], dict[str, Any]] = lambda step: {},
    observations: Any = VECTOR,
    actions: Any = None,
) -> type:
    """A class of environments that end after ``length`` steps."""

    class Own(gym.Env[Any, Any]):
        observation_space = observations
        action_space = actions if actions is not None else spaces.Discrete(3, start=1)
        render_mode = None

        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
            super().reset(seed=seed)
            self.at = 0
            self.taken: list[Any] = []
            return observe(0), inform(0)

        def step(self, action: Any) -> Any:
            self.at += 1
            return observe(self.at), 10.0 * self.at, self.at >= length, False, inform(self.at)

    return Own


def recorded(path: Path, env: type, episodes: int = 3, num_envs: int = 2, **options: Any) -> dict[str, Any]:
    """The columns of a recording, with its lengths as `ep_len`."""
    world = swm.World([env] * num_envs, max_episode_steps=50, add_pixels=False)
    world.set_policy("random")
    world.collect(path, episodes=episodes, seed=0, mode="overwrite", progress=False, **options)
    with h5py.File(path) as file:
        return {name: file[name][()] for name in file if isinstance(file[name], h5py.Dataset)}


def first(columns: dict[str, Any], name: str) -> list[Any]:
    """The first episode of a column."""
    return columns[name][: columns["ep_len"][0]].tolist()


def test_rows_are_steps_and_the_last_has_no_action(tmp_path: Path) -> None:
    for space, missing in (
        (spaces.Discrete(3, start=1), -1),
        (spaces.MultiDiscrete([3, 4]), [-1, -1]),
        (spaces.MultiBinary(3), [-1, -1, -1]),
        (spaces.Box(-1, 1, (2,)), None),
    ):
        found = recorded(tmp_path / "own.h5", own(actions=space))
        assert found["ep_len"].tolist() == [4, 4, 4]
        action = found["action"][:4]
        assert np.isnan(action[-1]).all() if missing is None else action[-1].tolist() == missing, space
        assert all(space.contains(one.astype(space.dtype)) for one in action[:-1])
        assert np.isnan(found["reward"][0]) and found["reward"][1:4].tolist() == [10, 20, 30]
        assert found["terminated"][:4].tolist() == [False, False, False, True]


def test_goals_of_an_evaluation_are_no_columns_of_the_next_recording(tmp_path: Path) -> None:
    before = recorded(tmp_path / "own.h5", own(length=6), num_envs=1)
    world = swm.World([own(length=6)], max_episode_steps=50, add_pixels=False)
    world.set_policy("random")
    dataset = swm.data.load_dataset(tmp_path / "own.h5")
    swm.evaluate_from_dataset(world, dataset, [0], [0], goal_offset=2, eval_budget=3)
    goals = {name for name in world.infos if name.startswith("goal")}
    assert goals, "they stay until the next episodes begin"
    world.collect(tmp_path / "later.h5", episodes=3, seed=0, progress=False)
    with h5py.File(tmp_path / "later.h5") as file:
        assert {name for name in file if isinstance(file[name], h5py.Dataset)} == set(before)
    assert not goals & set(world.infos)


def test_goals_of_an_evaluation_that_failed_are_no_columns_either(tmp_path: Path) -> None:
    before = recorded(tmp_path / "own.h5", own(length=6), num_envs=1)
    world = swm.World([own(length=6)], max_episode_steps=50, add_pixels=False)

    def fails(infos: dict[str, Any]) -> Any:
        raise LookupError("the model is lost")

    world.set_policy(fails)
    dataset = swm.data.load_dataset(tmp_path / "own.h5")
    with pytest.raises(LookupError):
        swm.evaluate_from_dataset(world, dataset, [0], [0], goal_offset=2, eval_budget=3)
    world.set_policy("random")
    world.collect(tmp_path / "later.h5", episodes=3, seed=0, progress=False)
    with h5py.File(tmp_path / "later.h5") as file:
        assert {name for name in file if isinstance(file[name], h5py.Dataset)} == set(before)


def test_actions_may_be_dicts(tmp_path: Path) -> None:
    parts = spaces.Dict(a=spaces.Discrete(2), b=spaces.Dict(c=spaces.Box(-1, 1, (2,))))
    found = recorded(tmp_path / "own.h5", own(actions=parts))
    assert found["action.a"][3] == -1 and np.isnan(found["action.b.c"][3]).all()
    assert set(found["action.a"][:3]) <= {0, 1} and np.isfinite(found["action.b.c"][:3]).all()


def test_nested_observations_have_dotted_names(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    nested = spaces.Dict(
        a=spaces.Dict(b=spaces.Box(-9, 9, (1,))), c=spaces.Discrete(9), d=spaces.Tuple((spaces.Discrete(9), spaces.Box(-9, 9, (2,))))
    )

    def observe(step: int) -> Any:
        return {"a": {"b": np.array([step], np.float32)}, "c": step, "d": (step, np.array([step, 2], np.float32))}

    found = recorded(tmp_path / "own.h5", own(observe=observe, observations=nested))
    assert first(found, "a.b") == [[0], [1], [2], [3]] and first(found, "c") == [0, 1, 2, 3]
    assert first(found, "d.0") == [0, 1, 2, 3] and first(found, "d.1") == [[0, 2], [1, 2], [2, 2], [3, 2]]
    assert not caplog.records
    world = swm.World([own(observe=observe, observations=nested)], add_pixels=False)
    world.reset(seed=0)
    assert world.infos["a.b"].shape == (1, 1, 1) and world.infos["d.1"].shape == (1, 1, 2)


def test_texts_lists_and_dicts_of_the_info_are_recorded_and_the_rest_is_noted_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def inform(step: int) -> dict[str, Any]:
        return {
            "word": f"w{step}",
            "raw": b"bytes",
            "d": {"x": step, "deep": {"y": 0.5}},
            "l": [step, step],
            "none": None,
            "thing": object(),
            "empty": np.zeros(0),
            "contacts": np.zeros(step),
            "essay": "x" * 200 * step,
            "texts": ["a", "b"],
        }

    with caplog.at_level(logging.INFO, "stable_worldmodel_rs"):
        found = recorded(tmp_path / "own.h5", own(inform=inform))
    assert [str(word, "utf8") if isinstance(word, bytes) else word for word in first(found, "word")] == ["w0", "w1", "w2", "w3"]
    assert first(found, "d.x") == [0, 1, 2, 3] and first(found, "d.deep.y") == [0.5] * 4
    assert first(found, "l") == [[0, 0], [1, 1], [2, 2], [3, 3]]
    assert {"raw", "texts.0", "texts.1"} <= set(found)
    notes = [record.getMessage() for record in caplog.records if "is not recorded" in record.getMessage()]
    for name, reason in (("none", "None"), ("thing", "object is no number"), ("empty", "holds no values"), ("contacts", r"\(1,\)"), ("essay", "400 bytes; 256 is the most")):
        told = [note for note in notes if note.startswith(f"`{name}`")]
        assert len(told) == 1 and re.search(reason, told[0]), (name, notes)
    assert len(notes) == 5


def test_infos_that_come_late_are_missing_before(tmp_path: Path) -> None:
    def inform(step: int) -> dict[str, Any]:
        return {"success": True, "score": 3.5, "count": 7, "note": "end"} if step == 3 else {}

    found = recorded(tmp_path / "own.h5", own(inform=inform), episodes=5)
    for episode in range(5):
        rows = slice(4 * episode, 4 * episode + 4)
        assert found["success"][rows].tolist() == [False, False, False, True]
        assert np.isnan(found["score"][rows][:3]).all() and found["score"][rows][3] == 3.5
        assert found["count"][rows].tolist() == [-1, -1, -1, 7]
        assert [bytes(text) if isinstance(text, bytes) else text.encode() for text in found["note"][rows]] == [b"", b"", b"", b"end"]


def test_infos_that_go_are_missing_after_and_those_of_the_reset_alone_are_constants(tmp_path: Path) -> None:
    def inform(step: int) -> dict[str, Any]:
        given: dict[str, Any] = {"even": step} if step % 2 == 0 else {}
        return {**given, "goal": np.array([1.0, 2.0])} if step == 0 else given

    found = recorded(tmp_path / "own.h5", own(length=4, inform=inform))
    assert first(found, "even") == [0, -1, 2, -1, 4]
    assert first(found, "goal") == [[1.0, 2.0]] * 5
    seen: list[Any] = []

    def policy(infos: dict[str, Any]) -> Any:
        seen.append((infos["goal"][:, 0].tolist(), infos["even"][0, 0]))
        return np.ones(1, np.int64)

    world = swm.World([own(length=4, inform=inform)], add_pixels=False)
    world.set_policy(policy)
    world.evaluate(episodes=2, seed=0)
    assert [goal for goal, _ in seen] == [[[1.0, 2.0]]] * 8, "policies see the constant at every step"


def test_a_first_value_does_not_narrow_the_type(tmp_path: Path) -> None:
    found = recorded(tmp_path / "own.h5", own(inform=lambda step: {"score": step / 2 if step else 0, "maybe": 0.5 if step > 1 else None}))
    assert first(found, "score") == [0, 0.5, 1, 1.5]
    assert np.isnan(found["maybe"][:2]).all() and found["maybe"][2:4].tolist() == [0.5, 0.5]


def test_an_observation_that_is_omitted_is_an_error_that_names_it(tmp_path: Path) -> None:
    both = spaces.Dict(near=spaces.Box(-9, 9, (1,)), far=spaces.Dict(x=spaces.Box(-9, 9, (1,))))
    for name, lacking in (("near", {"far": {"x": np.zeros(1)}}), ("far.x", {"near": np.zeros(1), "far": {}})):

        def observe(step: int, lacking: dict[str, Any] = lacking) -> Any:
            return {"near": np.zeros(1), "far": {"x": np.zeros(1)}} if step < 2 else lacking

        with pytest.raises(ValueError, match=rf"lacks `{name}` at step 2.*return every entry"):
            recorded(tmp_path / "own.h5", own(observe=observe, observations=both))


def test_names_that_differ_between_environments_are_missing_where_they_are_not_given(tmp_path: Path) -> None:
    rich, poor = own(inform=lambda step: {"extra": 1.0}), own()
    for envs in ([rich, poor], [poor, rich]):
        world = swm.World(envs, add_pixels=False)
        world.reset(seed=0)
        extra = world.infos["extra"][:, 0]
        assert np.isnan(extra[envs.index(poor)]) and extra[envs.index(rich)] == 1
        world.set_policy("random")
        world.collect(tmp_path / "two.h5", episodes=2, seed=0, mode="overwrite", progress=False)
        with h5py.File(tmp_path / "two.h5") as file:
            assert np.isnan(file["extra"][()]).sum() == 4


def test_formats_and_buffers_take_them(tmp_path: Path) -> None:
    world = swm.World([own(inform=lambda step: {"word": f"w{step}", "d": {"x": step}})] * 2, add_pixels=False)
    world.set_policy("random")
    for name in ("own.folder", "own.mcap", "own.lerobot"):
        world.collect(tmp_path / name, episodes=2, seed=0, progress=False)
        assert "d.x" in swm.data.load_dataset(tmp_path / name).column_names, name
    buffer = swm.data.ReplayBuffer(max_steps=100)
    world.collect(writer=buffer, episodes=2, seed=0, progress=False)
    assert "d.x" in buffer.column_names


def test_a_recording_begins_anew_and_needs_no_seed(tmp_path: Path) -> None:
    world = swm.World([own()] * 2, add_pixels=False)
    world.set_policy("random")
    for path in ("a.h5", "b.h5"):
        world.collect(tmp_path / path, episodes=3, progress=False)
        lengths = swm.data.load_dataset(tmp_path / path).lengths
        assert lengths.tolist() == [4, 4, 4], "no episode lacks its first row"
    assert world.evaluate(episodes=2)["episodes"] == 2


def test_a_step_of_no_environment_is_refused() -> None:
    world = swm.World([own(length=1), own(length=2)], add_pixels=False)
    actions = np.ones(2, np.int64)
    with pytest.raises(AttributeError, match="no episode has begun; call `reset`"):
        world.step(actions)
    world.reset(seed=0)
    world.step(actions)
    assert world.terminateds is not None and world.terminateds.tolist() == [True, False]
    world.step(actions)
    assert world.terminateds.tolist() == [False, True] and world.infos["step_idx"].ravel().tolist() == [1, 2]
    with pytest.raises(swm.EnvError, match="are over; call `reset`"):
        world.step(actions)
    assert world.terminateds.tolist() == [False, True]
    world.reset()
    world.step(actions)
