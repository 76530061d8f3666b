"""The replay buffer: a ring of whole episodes, written, sampled, stored."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from data_makers import episode

KEY = swm.data.EPISODE_DATA_KEY


def rows(length: int, seed: int) -> dict[str, Any]:
    return {key: value for key, value in episode(length, seed, size=8).items() if key != "env_name"}


@pytest.fixture
def buffer() -> swm.data.ReplayBuffer:
    buffer = swm.data.ReplayBuffer(40, history_len=3, frameskip=2, seed=0)
    for seed, length in enumerate((15, 12, 20)):  # The first leaves for the third, whose rows go round the end.
        buffer.write_episode(rows(length, seed))
    return buffer


def test_the_oldest_leave(buffer: swm.data.ReplayBuffer) -> None:
    assert buffer.lengths.tolist() == [12, 20] and buffer.offsets.tolist() == [0, 12]
    assert buffer.num_steps_stored == 32 and buffer.num_episodes == 2
    np.testing.assert_array_equal(buffer.get_col_data("count"), np.concatenate([rows(12, 1)["count"], rows(20, 2)["count"]]))
    np.testing.assert_array_equal(buffer.load_episode(1)["pixels"], rows(20, 2)["pixels"])
    np.testing.assert_array_equal(buffer.get_row_data([0, 12])["count"], [1000, 2000])


def test_clips(buffer: swm.data.ReplayBuffer) -> None:
    assert len(buffer) == (12 - 5) + (20 - 5) and buffer.clip_indices[7] == (1, 0)
    for index in range(len(buffer)):
        seed, start = buffer.clip_indices[index]
        wanted, clip = rows((12, 20)[seed], seed + 1), buffer[index]
        np.testing.assert_array_equal(clip["count"], wanted["count"][start : start + 6 : 2])
        np.testing.assert_array_equal(clip["action"], wanted["action"][start : start + 6].reshape(3, 4))
    with pytest.raises(IndexError):
        buffer[len(buffer)]
    with pytest.raises(IndexError, match="empty"):
        swm.data.ReplayBuffer(5)[0]


def test_samples(buffer: swm.data.ReplayBuffer) -> None:
    batch = buffer.sample(64)
    assert batch["pixels"].shape == (64, 3, 8, 8, 3) and batch["action"].shape == (64, 3, 4)
    assert (np.diff(batch["count"]) == 2).all(), "a clip goes over the end of its episode"
    again = swm.data.ReplayBuffer(40, history_len=3, frameskip=2, seed=0)
    for seed, length in enumerate((15, 12, 20)):
        again.write_episode(rows(length, seed))
    np.testing.assert_array_equal(again.sample(64)["count"], batch["count"])
    assert buffer.sample(2, history_len=5)["state"].shape == (2, 5, 3)
    with pytest.raises(RuntimeError, match="no clips"):
        buffer.sample(1, history_len=50)


def test_samplers_choose() -> None:
    asked: list[tuple[int, int, int]] = []

    def last(step: int, buffer: swm.data.ReplayBuffer, batch_size: int, history_len: int) -> Any:
        asked.append((step, batch_size, history_len))
        return np.full(batch_size, buffer.num_valid_ends(history_len) - 1)

    buffer = swm.data.ReplayBuffer(40, sampler=last)
    buffer.write_episode(rows(9, 0))
    assert buffer.sample(2)["count"].tolist() == [[8], [8]]
    buffer.sample(3, history_len=4, step=70)
    buffer.sample(1)
    assert asked == [(0, 2, 1), (70, 3, 4), (1, 1, 1)]


def test_what_does_not_fit_is_refused() -> None:
    buffer = swm.data.ReplayBuffer(10, key_filter=swm.data.classic_filter)
    buffer.write_episode({"action": np.zeros((4, 2)), "other": np.zeros(4)})
    assert buffer.column_names == ["action"]
    for wrong, match in (
        ({"action": np.zeros((11, 2))}, "exceeds max_steps=10"),
        ({"action": np.zeros((3, 3))}, "per-step shape"),
        ({"action": 3}, "scalar"),
        ({"action": np.zeros((3, 2)), "reward": np.zeros(4)}, "has 4 steps, expected 3"),
        ({"reward": np.zeros(3)}, "schema mismatch"),
    ):
        with pytest.raises(ValueError, match=match):
            buffer.write_episode(wrong)
    assert buffer.num_steps_stored == 4
    for options in ({"max_steps": 0}, {"max_steps": 5, "history_len": 0}, {"max_steps": 5, "frameskip": -1}):
        with pytest.raises(ValueError, match="must be positive"):
            swm.data.ReplayBuffer(**options)


def test_dumps(buffer: swm.data.ReplayBuffer, tmp_path: Path) -> None:
    for format, name in (("hdf5", "a.h5"), ("folder", "a"), ("mcap", "a.mcap")):
        buffer.dump(tmp_path / name, format)
        stored = swm.data.load_dataset(tmp_path / name)
        assert stored.lengths.tolist() == [12, 20]
        np.testing.assert_array_equal(stored.get_col_data("action"), buffer.get_col_data("action"))


def test_values_of_episodes(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    buffer = swm.data.ReplayBuffer(20)
    buffer.write_episode({"action": np.zeros((4, 2)), KEY: {"scene": "<a/>"}})
    buffer.write_episode({"action": np.zeros((4, 2))})
    assert buffer.get_episode_data() == {"scene": ["<a/>", None]}
    assert buffer.get_episode_data([1, 0]) == {"scene": [None, "<a/>"]}
    assert [episode.get(KEY) for episode in buffer.episodes()] == [{"scene": "<a/>"}, None]
    buffer.dump(tmp_path / "a.h5", "hdf5")
    assert "scene" in caplog.text
    buffer.clear()
    assert len(buffer) == 0 and buffer.get_episode_data() == {}


def test_a_buffer_can_be_pickled(buffer: swm.data.ReplayBuffer) -> None:
    again = pickle.loads(pickle.dumps(buffer))
    np.testing.assert_array_equal(again[3]["state"], buffer[3]["state"])
    assert "episodes=2, steps=32/40" in repr(again)


def test_a_world_fills_it() -> None:
    world = swm.World("swm/PushT-v1", num_envs=2, image_shape=(16, 16), max_episode_steps=8)
    world.set_policy("random")
    buffer = swm.data.ReplayBuffer(100, history_len=2)
    world.collect(episodes=3, seed=1, writer=buffer, progress=False)
    assert buffer.num_episodes == 3 and buffer.sample(4)["pixels"].shape == (4, 2, 16, 16, 3)
