"""The loader: what batches hold, in which order, for how long, and where it goes on."""

from __future__ import annotations

import gc
import multiprocessing
import pickle
import resource
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from data_makers import array, episode, write
from stable_worldmodel_rs import _swm


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path / "toy.h5", lengths=(10, 7, 12))


def numbers(batch: dict[str, Any]) -> list[int]:
    """The first row of every clip, told by its column ``count``."""
    return array(batch["count"])[:, 0].tolist()


def copied(batch: dict[str, Any]) -> dict[str, Any]:
    return {key: list(values) if isinstance(values, list) else array(values).copy() for key, values in batch.items()}


def same(first: dict[str, Any], second: dict[str, Any]) -> bool:
    return first.keys() == second.keys() and all(np.array_equal(array(first[key]), array(second[key])) for key in first)


def test_batches_are_the_clips_of_the_dataset(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2, frameskip=2)
    loader = swm.data.Loader(dataset, batch_size=4, shuffle=False, float32=False)
    at = 0
    for batch in loader:
        for row in range(len(batch["action"])):
            clip = dataset[at]
            for key in clip:
                if isinstance(clip[key], str):
                    assert batch[key][row] == clip[key]
                else:
                    np.testing.assert_array_equal(array(batch[key])[row], array(clip[key]))
            at += 1
    assert at == len(dataset) == loader.num_clips and len(loader) == -(-at // 4)
    assert batch["pixels"].shape[1:] == (2, 3, 32, 32) and batch["action"].shape[1:] == (2, 4)


def test_an_epoch_is_a_permutation_and_the_next_another(path: Path) -> None:
    loader = swm.data.Loader(path, batch_size=4, seed=3)
    epochs = [[number for batch in loader for number in numbers(batch)] for _ in range(3)]
    everything = sorted(1000 * seed + step for seed, length in enumerate((10, 7, 12)) for step in range(length))
    assert all(sorted(epoch) == everything for epoch in epochs)
    assert epochs[0] != epochs[1] != epochs[2]
    for threads in (1, 3):
        again = swm.data.Loader(path, batch_size=4, seed=3, threads=threads)
        assert [[number for batch in again for number in numbers(batch)] for _ in range(3)] == epochs
    other = swm.data.Loader(path, batch_size=4, seed=4)
    assert [number for batch in other for number in numbers(batch)] != epochs[0]


def test_sizes(path: Path) -> None:
    loader = swm.data.Loader(path, batch_size=4, drop_last=True)
    assert [len(batch["count"]) for batch in loader] == [4] * 7 and len(loader) == 7
    assert [len(batch["count"]) for batch in swm.data.Loader(path, batch_size=4)] == [4] * 7 + [1]
    for size in (0, -1):
        with pytest.raises(swm.DataError, match=f"Loader: batch_size={size}: use 1 or more"):
            swm.data.Loader(path, batch_size=size)
    with pytest.raises(swm.DataError, match="drop_last"):
        swm.data.Loader(path, batch_size=100, drop_last=True)
    with pytest.raises(swm.DataError, match="longest episode has 12"):
        swm.data.Loader(path, num_steps=13)
    with pytest.raises(swm.DataError, match="unknown field `nope`.*; there are: .*count"):
        swm.data.Loader(path, keys=["nope"])


def test_shards_divide_an_epoch(path: Path) -> None:
    whole = [n for batch in swm.data.Loader(path, batch_size=5, seed=1) for n in numbers(batch)]
    parts = [
        [n for batch in swm.data.Loader(path, batch_size=5, seed=1, shard=(rank, 3)) for n in numbers(batch)] for rank in range(3)
    ]
    assert [len(part) for part in parts] == [9, 9, 9]
    assert parts[1] == whole[1:27:3]
    with pytest.raises(swm.DataError, match="shard"):
        swm.data.Loader(path, shard=(3, 3))


@pytest.mark.parametrize("taken", range(9))
def test_it_goes_on_where_it_was(path: Path, taken: int) -> None:
    loader = swm.data.Loader(path, batch_size=4, seed=2)
    batches = iter(loader)
    for _ in range(taken):
        next(batches, None)
    state = pickle.loads(pickle.dumps(loader.state_dict()))
    rest = [numbers(batch) for batch in batches] or [numbers(batch) for batch in loader]
    again = swm.data.Loader(path, batch_size=4, seed=2)
    again.load_state_dict(state)
    assert [numbers(batch) for batch in again] == rest
    assert [numbers(batch) for batch in again] == [numbers(batch) for batch in loader]
    with pytest.raises(swm.DataError, match="position"):
        swm.data.Loader(path, batch_size=4, seed=5).load_state_dict(state)


def test_epochs_can_be_chosen_and_left(path: Path) -> None:
    epochs = [[numbers(batch) for batch in loader] for loader in [swm.data.Loader(path, batch_size=4)] for _ in range(3)]
    loader = swm.data.Loader(path, batch_size=4)
    epochs = [[numbers(batch) for batch in loader] for _ in range(4)]
    loader = swm.data.Loader(path, batch_size=4)
    loader.set_epoch(2)
    assert loader.epoch == 2 and [numbers(batch) for batch in loader] == epochs[2]
    assert [numbers(batch) for batch in loader] == epochs[3]
    loader.set_epoch(0)
    for batch in loader:
        break
    assert numbers(batch) == epochs[0][0]
    assert [numbers(batch) for batch in loader] == epochs[1]  # The one that was left is not taken up again.
    first, second = iter(loader), iter(loader)
    next(second)
    with pytest.raises(RuntimeError, match="second Loader"):
        next(first)


def test_batches_are_valid_while_they_are_held(path: Path) -> None:
    loader = swm.data.Loader(path, batch_size=3, num_steps=2, threads=2)
    kept, copies = [], []
    for _ in range(12):
        for batch in loader:
            kept.append(batch)
            copies.append(copied(batch))
    loader.close()
    del loader
    gc.collect()
    assert all(same(batch, copy) for batch, copy in zip(kept, copies, strict=True))
    single = kept[5]["state"]
    wanted = copies[5]["state"]
    del kept, batch
    gc.collect()
    assert np.array_equal(array(single), wanted)


def test_memory_goes_round(tmp_path: Path) -> None:
    path = write(tmp_path / "toy.h5", lengths=(40,))
    loader = swm.data.Loader(path, batch_size=8, keys=["pixels", "state"], output="numpy")
    places = {batch["pixels"].ctypes.data for _ in range(30) for batch in loader}
    assert len(places) <= 2 * 2 * 16 + 6, "every batch lies on new memory"
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    count = 0
    small = swm.data.Loader(path, batch_size=2, keys=["state"], output="numpy")
    while count < 100_000:
        for _batch in small:
            count += 1
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # KiB


def test_a_closed_loader_says_so(path: Path) -> None:
    with swm.data.Loader(path) as loader:
        next(iter(loader))
    with pytest.raises(ValueError, match="closed"):
        next(iter(loader))
    with pytest.raises(TypeError, match="state_dict"):
        pickle.dumps(loader)


def test_goals(path: Path) -> None:
    loader = swm.data.Loader(path, batch_size=8, num_steps=2, goals={"keys": ["state", "pixels"], "seed": 5}, shuffle=False)
    dataset = swm.data.load_dataset(path, num_steps=2)
    for epoch in range(2):
        at = 0
        for batch in loader:
            assert batch["goal_state"].shape[1:] == (1, 3) and batch["goal_pixels"].shape[1:] == (1, 3, 32, 32)
            for goal in array(batch["goal_state"])[:, 0]:
                wanted = loader._clips.goal(at, epoch)
                assert wanted == (goal[0], goal[1])
                at += 1
        assert at < len(dataset)  # Clips at the end of an episode have no future.
    future = swm.data.Loader(path, goals={"probabilities": (0, 0, 1, 0), "keys": ["state"]}, num_steps=2)
    for batch in future:
        state, goal = array(batch["state"])[:, -1], array(batch["goal_state"])[:, 0]
        assert (state[:, 0] == goal[:, 0]).all() and (goal[:, 1] > state[:, 1]).all()
    with pytest.raises(ValueError, match="unknown setting 'what'"):
        swm.data.Loader(path, goals={"what": 1})
    with pytest.raises(swm.DataError, match="sum to 1"):
        swm.data.Loader(path, goals={"probabilities": (1, 1, 0, 0)})


def test_goal_datasets_are_read_natively(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2)
    wrapped = swm.data.GoalDataset(dataset, goal_probabilities=(0.0, 0.0, 0.0, 1.0), goal_keys={"state": "target"}, seed=1)
    assert len(wrapped) == len(dataset)
    np.testing.assert_array_equal(array(wrapped[3]["target"]), array(dataset[3]["state"])[-1:])
    for batch in swm.data.Loader(wrapped, batch_size=4):
        np.testing.assert_array_equal(array(batch["target"]), array(batch["state"])[:, -1:])
        assert "goal_state" not in batch


def test_datasets_of_datasets(path: Path, tmp_path: Path) -> None:
    more = write(tmp_path / "more.mcap", "mcap", lengths=(6,))
    first, second = swm.data.load_dataset(path, num_steps=2), swm.data.load_dataset(more, num_steps=2)
    both = swm.data.ConcatDataset([first, second])
    loader = swm.data.Loader(both, batch_size=4, shuffle=False, float32=False)
    assert loader.num_clips == len(both)
    states = np.concatenate([array(batch["state"]) for batch in loader])
    np.testing.assert_array_equal(states, np.stack([array(both[at]["state"]) for at in range(len(both))]))

    with swm.data.HDF5Writer(tmp_path / "codes.h5") as writer:
        for seed, length in enumerate((10, 7, 12)):
            writer.write_episode({"code": episode(length, seed)["state"] * 2})
    merged = swm.data.MergeDataset([first, swm.data.load_dataset(tmp_path / "codes.h5", num_steps=2)])
    for batch in swm.data.Loader(merged, batch_size=4, float32=False):
        np.testing.assert_array_equal(array(batch["code"]), 2 * array(batch["state"]))
    with pytest.raises(ValueError, match=r"the same clips, and these have \[.*ConcatDataset"):
        swm.data.MergeDataset([first, both])
    joiners: list[Any] = [swm.data.ConcatDataset, swm.data.MergeDataset]
    for join in joiners:
        with pytest.raises(TypeError, match=r"datasets is \w+; give a list: \[dataset"):
            join(first)


@pytest.mark.parametrize("ahead", [0, 10**9])
def test_what_is_read_ahead_is_bounded(path: Path, ahead: int) -> None:
    with pytest.raises(swm.SwmError, match="`ahead`: .* batches per thread; use 1 to 1024"):
        next(iter(swm.data.Loader(path, batch_size=4, ahead=ahead)))


def test_replay_buffers(path: Path) -> None:
    buffer = swm.data.ReplayBuffer(25, history_len=2)
    for seed, length in enumerate((10, 7, 12)):
        buffer.write_episode({key: value for key, value in episode(length, seed).items() if key != "env_name"})
    loader = swm.data.Loader(buffer, batch_size=4, shuffle=False)
    assert loader.num_clips == len(buffer) == 6 + 11
    counts = [number for batch in loader for number in numbers(batch)]
    assert counts == [int(buffer[at]["count"][0]) for at in range(len(buffer))]


def test_tables_of_python(path: Path) -> None:
    """The road of pinned tensors, with plain arrays."""
    dataset = swm.data.load_dataset(path, num_steps=2)
    made: list[dict[str, Any]] = []

    def table() -> tuple[dict[str, Any], Any]:
        arrays = {
            name: np.full((4, *shape), 7, dtype) for name, dtype, shape, _ in dataset.clips.fields if dtype != "str"
        }
        made.append(arrays)
        return arrays, arrays

    stream = dataset.clips.batches(4, shuffle=1, epochs=2, make_table=table)
    plain = dataset.clips.batches(4, shuffle=1, epochs=2)
    count = 0
    for _ in range(20):
        read, wanted = stream.next(), plain.next()
        assert (read is None) == (wanted is None)
        if read is None or wanted is None:
            continue
        arrays, rows, texts = read
        assert any(arrays is known for known in made) and dict(texts)["env_name"] == wanted["env_name"]
        for name, values in arrays.items():
            np.testing.assert_array_equal(values[:rows], wanted[name])
        count += 1
    assert count == 2 * 7
    for wrong, match in (
        (lambda: ({}, None), "no array for column"),
        (lambda: ({name: np.zeros(3) for name in table()[0]}, None), "another type|has shape"),
        (lambda: ({name: _readonly(values) for name, values in table()[0].items()}, None), "column"),
        (lambda: ({name: values[:, ::-1] for name, values in table()[0].items()}, None), "contiguous"),
    ):
        with pytest.raises((TypeError, ValueError), match=match):
            dataset.clips.batches(4, make_table=wrong)


def _readonly(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    values.flags.writeable = False
    return values


def test_damage_is_an_error_and_the_rest_is_read(tmp_path: Path) -> None:
    path = write(tmp_path / "folder", "folder", lengths=(6, 6), text=False)
    (next(iter(sorted(path.glob("pixels/ep_0_step_2.*"))))).write_bytes(b"no image")
    loader = swm.data.Loader(path, batch_size=3, shuffle=False)
    batches = iter(loader)
    with pytest.raises(swm.DataError, match="ep_0_step_2"):
        next(batches)
    assert sum(len(batch["count"]) for batch in batches) == 9


def test_the_core_alone(path: Path) -> None:
    stream = swm.data.load_dataset(path).clips.batches(4, shuffle=1)
    assert [stream.skip(2), stream.skip(100), stream.skip(1)] == [8, 21, 4]
    stream.close()
    with pytest.raises(ValueError, match="closed"):
        stream.skip(1)


def test_threads_may_share_a_loader(path: Path) -> None:
    loader = swm.data.Loader(path, batch_size=2)
    taken: list[int] = []
    stream = loader._stream

    def take() -> None:
        while (read := stream.next()) is not None:
            taken.extend(numbers(read))

    threads = [threading.Thread(target=take) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=1)
    assert len(taken) >= 29
    loader.close()


def _in_a_fork(loader: Any, dataset: Any, queue: Any) -> None:
    try:
        next(iter(loader))
        queue.put("read")
    except swm.SwmError as error:
        queue.put(str(error))
    fresh = swm.data.Loader(dataset, batch_size=4, threads=2)
    queue.put(sum(len(batch["count"]) for batch in fresh))
    del loader


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_fork_makes_its_own_loader(path: Path) -> None:
    dataset = swm.data.load_dataset(path)
    loader = swm.data.Loader(dataset, batch_size=4)
    next(iter(loader))
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=_in_a_fork, args=(loader, dataset, queue))
    child.start()
    assert "fork of it" in queue.get(timeout=30)
    assert queue.get(timeout=30) == 29
    child.join(timeout=30)
    assert child.exitcode == 0


def test_repr(path: Path) -> None:
    text = repr(swm.data.Loader(path, batch_size=4))
    assert "29 clips, 8 batches of 4" in text and "pixels uint8 (4, 1, 3, 32, 32)" in text


def test_native_errors_are_those_of_python(path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        _swm.Reader.open("/nowhere/x.h5")
    with pytest.raises(TypeError, match=r"swm\.data\.split|DataLoader"):
        swm.data.Loader([1, 2, 3])


@pytest.mark.parametrize(("num_steps", "frameskip"), [(1, 1), (3, 1), (2, 3)])
def test_rewards_beside_the_actions_that_earn_them(tmp_path: Path, num_steps: int, frameskip: int) -> None:
    """Row t of a recording holds the reward of arriving at t: that of the action of row t - 1, and NaN in the first."""
    path = tmp_path / "pusht.h5"
    with swm.World("swm/PushT-v1", 2, add_pixels=False, max_episode_steps=9, threads=1) as world:
        world.set_policy("random")
        world.collect(path, episodes=3, seed=0, progress=False)
    clips = {"num_steps": num_steps, "frameskip": frameskip}
    recorded, aligned = swm.data.load_dataset(path, **clips), swm.data.load_dataset(path, **clips, rewards="action")
    rows = recorded.get_col_data("reward")
    starts = recorded.offsets
    assert np.isnan(rows[starts]).all() and np.isnan(rows).sum() == len(starts)
    loader = swm.data.Loader(aligned, batch_size=len(aligned), shuffle=False)
    batch = next(iter(loader))
    for number, (episode, first) in enumerate(aligned.clip_indices):
        own = rows[starts[episode] : starts[episode] + recorded.lengths[episode]]
        np.testing.assert_array_equal(array(recorded[number]["reward"]), own[first : first + aligned.span : frameskip])
        blocks = [own[first + step * frameskip + 1 :][:frameskip] for step in range(num_steps)]
        wanted = [block.sum() if len(block) == frameskip else np.nan for block in blocks]
        np.testing.assert_allclose(array(aligned[number]["reward"]), wanted, rtol=1e-15)
        np.testing.assert_allclose(array(batch["reward"])[number], np.float32(wanted), rtol=1e-7)
        has_no_action = np.isnan(array(aligned[number]["action"])).any(1)
        np.testing.assert_array_equal(np.isnan(wanted), has_no_action)
    again = next(iter(swm.data.Loader(recorded, batch_size=len(recorded), shuffle=False, rewards="action", float32=False)))
    np.testing.assert_array_equal(array(again["reward"]), [array(aligned[at]["reward"]) for at in range(len(aligned))])
    with pytest.raises(ValueError, match=r"rewards='next'; use 'recorded' \(row t: of arriving at t\) or 'action'"):
        swm.data.load_dataset(path, rewards="next")


def test_floating_point_is_of_32_bit_as_in_planning(path: Path) -> None:
    stored = next(iter(swm.data.Loader(path, shuffle=False, float32=False, goals={"keys": ["state"]}, output="numpy")))
    batch = next(iter(swm.data.Loader(path, shuffle=False, goals={"keys": ["state"]}, output="numpy")))
    for name in ("state", "goal_state", "reward"):
        assert stored[name].dtype == np.float64 and batch[name].dtype == np.float32
        np.testing.assert_array_equal(batch[name], stored[name].astype(np.float32))
    assert batch["action"].dtype == np.float32 and batch["count"].dtype == np.int64 and batch["pixels"].dtype == np.uint8


def test_a_cache_of_decoded_images_gives_the_same_batches(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "stable_worldmodel_rs")
    plain = [copied(batch) for batch in swm.data.Loader(path, batch_size=4, num_steps=2, image=(16, 16), seed=3)]
    for noted in (True, False):
        cached = swm.data.Loader(path, batch_size=4, num_steps=2, image=(16, 16), seed=3, cache="decoded")
        assert ("decoded 29 images of column `pixels`" in caplog.text) == noted
        caplog.clear()
        assert all(same(batch, wanted) for batch, wanted in zip(cached, plain, strict=True))
    with pytest.raises(swm.DataError, match=r"cache_limit.* need 27760 bytes .*limit of 1000"):
        swm.data.Loader(path, image=(17, 16), cache="decoded", cache_limit=1000)


def test_keywords_of_the_cache_are_checked(path: Path) -> None:
    with pytest.raises(ValueError, match="cache='memory': give 'decoded'"):
        swm.data.Loader(path, cache="memory")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="cache_limit=5: nothing is cached"):
        swm.data.Loader(path, cache_limit=5)
