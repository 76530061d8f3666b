"""Datasets of files: columns, rows, caches, subsets, copies in other processes and threads, images in notebooks."""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from data_makers import LENGTHS, array, episode, write

ROWS = sum(LENGTHS)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path / "datasets" / "toy.h5")


def test_names_and_paths(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    by_name = swm.data.HDF5Dataset("toy", cache_dir=tmp_path)
    assert by_name.h5_path == by_name.path == path
    monkeypatch.setenv("STABLEWM_HOME", str(tmp_path))
    assert swm.data.get_cache_dir() == tmp_path
    assert swm.data.load_dataset("toy.h5").path == path
    assert swm.data.HDF5Dataset("toy").path == path
    monkeypatch.chdir(path.parent)
    assert len(swm.data.load_dataset("toy.h5", cache_dir=tmp_path / "elsewhere")) == ROWS
    with pytest.raises(TypeError, match="`name` or `path`"):
        swm.data.HDF5Dataset()
    with pytest.raises(ValueError, match="remote"):
        swm.data.HDF5Dataset(path="s3://bucket/x.h5")
    with pytest.raises(KeyError, match=r"no column 'nope'; the columns are \["):
        swm.data.HDF5Dataset("toy", keys_to_load=["nope"])


def test_paths_are_no_names_of_the_cache(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    here = write(tmp_path / "here" / "toy.h5")
    monkeypatch.setenv("STABLEWM_HOME", str(tmp_path))
    monkeypatch.setenv("HOME", str(here.parent))
    monkeypatch.chdir(here.parent)
    assert swm.data.load_dataset("toy.h5").path == path
    (said,) = caplog.messages
    assert str(path) in said and "'./toy.h5'" in said
    caplog.clear()
    for name in ("./toy.h5", f"{here}", "~/toy.h5"):
        opened = swm.data.load_dataset(name)
        assert opened.path.samefile(here) and not caplog.messages, name
    here.unlink()
    for name in ("./toy.h5", "~/toy.h5", "../here/toy.h5"):
        with pytest.raises(FileNotFoundError, match=f"^'{name}' does not exist"):
            swm.data.load_dataset(name)
    monkeypatch.chdir(path.parent)
    assert swm.data.load_dataset("toy.h5").path == path and not caplog.messages
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(swm.DataError) as caught:
        swm.data.load_dataset(".")
    assert str(path.parent) not in str(caught.value)


def test_whole_columns_and_rows(path: Path) -> None:
    dataset = swm.data.load_dataset(path)
    together = {key: np.concatenate([np.asarray(episode(n, seed)[key]) for seed, n in enumerate(LENGTHS)]) for key in episode(1, 0)}
    for key, wanted in together.items():
        found = dataset.get_col_data(key)
        assert isinstance(found, np.ndarray) and found.shape == wanted.shape
        assert (found == wanted).all(), key
    assert dataset.get_dim("pixels") == 32 * 32 * 3 and dataset.get_dim("action") == 2 and dataset.get_dim("reward") == 1
    one, many = dataset.get_row_data(12), dataset.get_row_data([12, 0, -1])
    for key, wanted in together.items():
        assert (np.asarray(one[key]) == wanted[12]).all()
        assert (many[key] == wanted[[12, 0, -1]]).all()
    with pytest.raises(IndexError):
        dataset.get_row_data(ROWS)
    assert dataset.get_col_data("ep_idx").tolist() == sum(([e] * n for e, n in enumerate(LENGTHS)), [])
    assert dataset.get_col_data("step_idx").tolist() == sum((list(range(n)) for n in LENGTHS), [])
    with pytest.raises(KeyError, match="nope"):
        dataset.get_col_data("nope")


def test_indices_can_be_loaded_as_columns(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2, keys_to_load=["state", "step_idx", "episode_idx"])
    clip = dataset[9]
    assert array(clip["step_idx"]).tolist() == [0, 1] and array(clip["episode_idx"]).tolist() == [1, 1]


def test_out_of_range(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=8)
    assert len(dataset) == 3 + 0 + 5
    for index in (8, -9):
        with pytest.raises(IndexError):
            dataset[index]
        with pytest.raises(IndexError):
            dataset.__getitems__([0, index])
    assert len(list(dataset)) == 8
    assert list(dataset.__getitems__([])) == []
    with pytest.raises(swm.DataError, match="7 rows"):
        dataset.load_chunk([1], [0], [8])
    with pytest.raises(swm.DataError, match=r"spans 100 rows \(num_steps=50 × frameskip=2\), and the longest episode has 12"):
        swm.data.load_dataset(path, num_steps=50, frameskip=2)
    with pytest.raises(ValueError, match="1 or more"):
        swm.data.load_dataset(path, num_steps=0)


def test_cached_and_merged_columns(path: Path) -> None:
    plain = swm.data.load_dataset(path, num_steps=2, frameskip=2)
    dataset = swm.data.load_dataset(
        path, num_steps=2, frameskip=2, keys_to_cache=["action", "reward"], keys_to_merge={"both": "state|action"}
    )
    assert set(dataset._cache) == {"action", "reward", "both"}
    np.testing.assert_array_equal(dataset._cache["action"], plain.get_col_data("action"))
    with pytest.raises(ValueError):
        dataset.merge_col(["state", "count"], "wrong")  # (N, 3) and (N,)
    for index in (0, 7, len(plain) - 1):
        for key in plain[index]:
            assert (np.asarray(dataset[index][key]) == np.asarray(plain[index][key])).all()


def test_merging_joins_along_the_last_axis(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2, keys_to_load=["state"])
    dataset.merge_col(["action", "state"], "both")
    assert dataset.column_names == ["state", "both"] and dataset.get_dim("both") == 5
    wanted = np.concatenate([dataset.get_col_data("action"), dataset.get_col_data("state")], axis=-1)
    np.testing.assert_array_equal(dataset.get_col_data("both"), wanted)
    np.testing.assert_array_equal(array(dataset[10]["both"]), wanted[11:13])
    assert swm.data.Loader(dataset, batch_size=2).num_clips == len(dataset)


def test_transforms_see_dense_actions(path: Path) -> None:
    shapes: list[Any] = []

    def transform(clip: dict[str, Any]) -> dict[str, Any]:
        shapes.append(tuple(clip["action"].shape))
        clip["action"] = clip["action"] * 2
        return clip

    plain = swm.data.load_dataset(path, num_steps=2, frameskip=3, keys_to_load=["action"])
    dataset = swm.data.load_dataset(path, num_steps=2, frameskip=3, keys_to_load=["action"], transform=transform)
    np.testing.assert_array_equal(array(dataset[3]["action"]), 2 * array(plain[3]["action"]))
    items = dataset.__getitems__([0, 1])
    assert items[1]["action"].shape == (2, 6) and shapes == [(6, 2)] * 3
    batch = next(iter(swm.data.Loader(dataset, batch_size=4, shuffle=False)))
    np.testing.assert_array_equal(array(batch["action"])[3], 2 * array(plain[3]["action"]))


def test_subclasses_may_read_otherwise(path: Path) -> None:
    class Twice(swm.data.HDF5Dataset):
        def _load_slice(self, ep_idx: int, start: int, end: int) -> dict[str, Any]:
            steps = super()._load_slice(ep_idx, start, end)
            return {"state": steps["state"] * 2}

    dataset = Twice(path=path, num_steps=2)
    plain = swm.data.load_dataset(path, num_steps=2)
    np.testing.assert_array_equal(array(dataset[0]["state"]), 2 * array(plain[0]["state"]))
    assert len(dataset.__getitems__([0, 1])) == 2
    with pytest.raises(TypeError, match="_load_slice of its own"):
        swm.data.Loader(dataset)


def test_images_are_resized_and_gray_or_float_images_keep_their_layout(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", text=False)
    assert swm.data.load_dataset(path, image=(16, 24))[0]["pixels"].shape == (1, 3, 16, 24)
    columns = {"gray": (5, 8, 8, 1), "deep": (5, 8, 8, 4), "planes": (5, 3, 8, 8)}
    rng = np.random.default_rng(0)
    values: dict[str, Any] = {name: rng.integers(0, 255, shape).astype(np.uint8) for name, shape in columns.items()}
    values["float"] = rng.random((5, 8, 8, 3)).astype(np.float32)
    with swm.data.HDF5Writer(tmp_path / "b.h5") as writer:
        writer.write_episode(values)
    dataset = swm.data.load_dataset(tmp_path / "b.h5", num_steps=2)
    wanted = {
        "gray": values["gray"].transpose(0, 3, 1, 2),
        "deep": values["deep"],
        "planes": values["planes"],
        "float": values["float"].transpose(0, 3, 1, 2),
    }
    batch = next(iter(swm.data.Loader(dataset, batch_size=4, shuffle=False)))
    for name, expected in wanted.items():
        np.testing.assert_array_equal(array(dataset[1][name]), expected[1:3], err_msg=name)
        np.testing.assert_array_equal(array(dataset.load_episode(0)[name]), expected, err_msg=name)
        np.testing.assert_array_equal(array(batch[name])[1], expected[1:3], err_msg=name)


def test_subsets_and_splits(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2)
    dataset.merge_col(["action", "state"], "both")
    part = dataset.subset([2, 0])
    assert part.lengths.tolist() == [12, 10] and len(part) == 20 and len(dataset) == ROWS - 3
    np.testing.assert_array_equal(array(part[0]["both"]), array(dataset[9 + 6]["both"]))
    assert part.subset([1]).episodes == [0]
    for mask in ([True, False, True], np.array([True, False, True])):
        with pytest.raises(TypeError, match=r"np\.flatnonzero\(mask\)"):
            dataset.subset(mask)
    parts = swm.data.split(dataset, [0.7, 0.3], seed=1)
    assert sorted(sum((list(p.episodes or []) for p in parts), [])) == [0, 1, 2]
    assert [p.episodes for p in parts] == [p.episodes for p in swm.data.split(dataset, [0.7, 0.3], seed=1)]
    with pytest.raises(ValueError, match="at most 1"):
        swm.data.split(dataset, [0.9, 0.9])


def test_held_out_episodes_are_those_of_manifests(tmp_path: Path) -> None:
    path = tmp_path / "recorded.h5"
    world = swm.World("swm/TwoRoom-v2", num_envs=4, add_pixels=False, max_episode_steps=40)
    world.set_policy("expert")
    world.collect(path, episodes=30, seed=3)
    dataset = swm.data.load_dataset(path, num_steps=2)
    training, held_out = swm.data.split_held_out(dataset, 0.4)
    assert sorted([*training.episodes, *held_out.episodes]) == list(range(30)) and len(held_out.episodes) > 3
    task = tmp_path / "task.json"
    made = swm.make_manifest(task, "swm/TwoRoom-v2", 3, tier="moderate", dataset=path, goal_offset=12, held_out=0.4)
    assert {pair["from"][0] for pair in made["pairs"]} <= set(held_out.episodes)
    chosen = swm.make_manifest(
        tmp_path / "chosen.json", "swm/TwoRoom-v2", dataset=path, pairs=[(3, 0, 4), "5:1-3"]
    )
    assert [pair["from"] for pair in chosen["pairs"]] == [[3, 0, 4], [5, 1, 3]]
    for wrong, words in [((3, 0), "episode, start, goal"), ("3", "3"), ((99, 0, 1), "episode 99")]:
        with pytest.raises(ValueError, match=words):
            swm.make_manifest(tmp_path / "wrong.json", "swm/TwoRoom-v2", dataset=path, pairs=[wrong])  # type: ignore[list-item]
    with pytest.raises(ValueError, match="give dataset"):
        swm.make_manifest(tmp_path / "wrong.json", "swm/TwoRoom-v2", pairs=[(3, 0, 8)])
    # A part of a dataset keeps the positions of its episodes.
    assert swm.data.split_held_out(held_out, 0.4)[1].episodes == held_out.episodes
    with pytest.raises(ValueError, match="use 0 to 1"):
        swm.data.split_held_out(dataset, 20)


def test_statistics_and_verification(path: Path) -> None:
    dataset = swm.data.load_dataset(path)
    found = dataset.statistics(["action"])["action"]
    np.testing.assert_allclose(found["mean"], dataset.get_col_data("action").mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(found["std"], dataset.get_col_data("action").std(axis=0), rtol=1e-6)
    assert dataset.verify()["problems"] == []
    log = write(path.with_name("toy.mcap"), "mcap")
    data = bytearray(log.read_bytes())
    data[len(data) // 2] ^= 1
    log.write_bytes(bytes(data))
    assert swm.data.load_dataset(log).verify()["problems"]


def test_pickling_reopens(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2, frameskip=2, keys_to_cache=["action"])
    dataset.merge_col(["action", "state"], "both")
    again = pickle.loads(pickle.dumps(dataset))
    assert again._reader is None and len(again) == len(dataset)
    np.testing.assert_array_equal(array(again[3]["both"]), array(dataset[3]["both"]))


def _read(dataset: Any, queue: Any) -> None:
    clips = dataset.__getitems__(list(range(len(dataset))))
    queue.put((float(array(swm.data.collate(clips)["state"]).sum()), array(dataset.load_episode(1)["count"]).sum()))


@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_other_processes_read_open_datasets(path: Path, method: str) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2)
    clips = dataset.__getitems__(list(range(len(dataset))))  # The pool of threads exists before the fork.
    wanted = float(array(swm.data.collate(clips)["state"]).sum())
    context = multiprocessing.get_context(method)
    queue = context.Queue()
    workers = [context.Process(target=_read, args=(dataset, queue)) for _ in range(2)]
    for worker in workers:
        worker.start()
    found = [queue.get(timeout=60) for _ in workers]
    for worker in workers:
        worker.join(timeout=60)
        assert worker.exitcode == 0
    assert {value for value, _ in found} == {wanted}


def _write_in_a_fork(folder: Path, queue: Any) -> None:
    write(folder / "fork.h5", lengths=(4,))
    try:
        write(folder / "fork.mcap", "mcap", lengths=(4,))
    except swm.SwmError as error:
        queue.put(str(error))


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_fork_writes_hdf5_and_refuses_the_rest(tmp_path: Path) -> None:
    write(tmp_path / "before.mcap", "mcap")
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=_write_in_a_fork, args=(tmp_path, queue))
    child.start()
    assert "spawn" in queue.get(timeout=30)
    child.join(timeout=30)
    assert child.exitcode == 0 and swm.data.load_dataset(tmp_path / "fork.h5").lengths.tolist() == [4]


def test_reading_can_be_interrupted(tmp_path: Path) -> None:
    """Ctrl-C while all images are read: the exception comes within 0.3 s and not at the end."""
    path = write(tmp_path / "long.h5", lengths=(400,) * 10, text=False)
    code = f"""
import signal, threading, time, os
import stable_worldmodel_rs as swm
# A shell starts background jobs with the signal ignored, and Python then leaves it so.
signal.signal(signal.SIGINT, signal.default_int_handler)
dataset = swm.data.load_dataset({str(path)!r})
reader = dataset.reader
sent = []
def send():
    time.sleep(0.1)
    sent.append(time.monotonic())
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=send).start()
try:
    while True:
        dataset.statistics()
        dataset.get_col_data("pixels")
except KeyboardInterrupt:
    print(time.monotonic() - sent[0])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert float(done.stdout) < 0.3, done.stdout


def test_threads_share_a_dataset(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2)
    wanted = [array(dataset[index]["state"]) for index in range(len(dataset))]
    wrong: list[int] = []

    def read(seed: int) -> None:
        rng = np.random.default_rng(seed)
        for index in rng.integers(0, len(dataset), 200).tolist():
            if not np.array_equal(array(dataset[index]["state"]), wanted[index]):
                wrong.append(index)

    threads = [threading.Thread(target=read, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_items_outlive_their_dataset(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2)
    kept = [dataset[index] for index in range(10)]
    copies = [{key: np.array(value) for key, value in item.items() if not isinstance(value, str)} for item in kept]
    for index in range(200):
        dataset[index % len(dataset)]
    del dataset
    gc.collect()
    for item, copied in zip(kept, copies, strict=True):
        for key, value in copied.items():
            np.testing.assert_array_equal(array(item[key]), value)
        array(item["state"])[:] = 0  # Writable, and nobody else's.


def test_opening_is_quick(tmp_path: Path) -> None:
    rows = 200_000
    with swm.data.HDF5Writer(tmp_path / "long.h5") as writer:
        for _ in range(2):
            writer.write_episode({"action": np.zeros((rows // 2, 2), np.float32)})
    start = time.perf_counter()
    dataset = swm.data.load_dataset(tmp_path / "long.h5", num_steps=4)
    clip = dataset[rows // 2]
    assert time.perf_counter() - start < 2 and clip["action"].shape == (4, 2)
    assert len(dataset) == rows - 6 and dataset.clip_indices[-1] == (1, rows // 2 - 4)


def test_clip_indices_are_a_sequence() -> None:
    indices = swm.data.ClipIndices([3, 1, 4], 2)
    assert list(indices) == indices == [(0, 0), (0, 1), (2, 0), (2, 1), (2, 2)]
    assert indices[-1] == (2, 2) and indices[1:3] == [(0, 1), (2, 0)] and (2, 1) in indices
    episodes, starts = indices.arrays()
    assert list(zip(episodes.tolist(), starts.tolist(), strict=True)) == list(indices)
    with pytest.raises(IndexError):
        indices[5]


def test_showing(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2)
    text = repr(dataset)
    assert "HDF5Dataset" in text and "3 episodes" in text and "29 rows" in text and "'pixels'" in text
    html = dataset._repr_html_()
    assert html.count("data:image/png;base64,") == 1 and "<td>action</td><td>float32</td><td>(2,)</td>" in html
    from stable_worldmodel_rs.data import _show

    frames = _show.samples(dataset)
    assert frames is not None and frames.shape == (3 * 4, 32, 32, 3)
    np.testing.assert_array_equal(frames[0], episode(10, 0)["pixels"][0])
    np.testing.assert_array_equal(frames[7], episode(7, 1)["pixels"][-1])


def test_recordings_without_images_are_rendered(tmp_path: Path) -> None:
    world = swm.World("swm/PushT-v1", num_envs=2, image_shape=(32, 32), max_episode_steps=12)
    world.set_policy("random")
    world.collect(tmp_path / "full.h5", episodes=2, seed=3, progress=False)
    blind = swm.World("swm/PushT-v1", num_envs=2, add_pixels=False, max_episode_steps=12)
    blind.set_policy("random")
    blind.collect(tmp_path / "blind.h5", episodes=2, seed=3, progress=False)
    full = swm.data.load_dataset(tmp_path / "full.h5", num_steps=3)
    drawn = swm.data.load_dataset(tmp_path / "blind.h5", num_steps=3, render=(32, 32))
    assert "pixels" not in swm.data.load_dataset(tmp_path / "blind.h5").column_names
    with pytest.raises(KeyError, match=r"no column 'pixels'; render=\(64, 64\) renders"):
        swm.data.load_dataset(tmp_path / "blind.h5", keys_to_load=["pixels"])
    for index in (0, 5, len(full) - 1):
        np.testing.assert_array_equal(array(drawn[index]["pixels"]), array(full[index]["pixels"]))
    assert full.metadata is not None and full.metadata["env"] == "swm/PushT-v1" and full.metadata["seed"] == 3
    # Python episodes continue a recording.
    with swm.data.HDF5Writer(tmp_path / "full.h5") as writer:
        row = {key: full.get_col_data(key)[:5] for key in full.column_names}
        writer.write_episode(row)
    assert len(swm.data.load_dataset(tmp_path / "full.h5").lengths) == 3


def test_processes_are_told_apart(path: Path) -> None:
    dataset = swm.data.load_dataset(path)
    before = dataset.reader
    assert dataset.reader is before
    dataset._pid = os.getpid() + 1
    assert dataset.reader is not before


def test_wrong_distances_and_columns_are_refused(path: Path) -> None:
    for wrong in (0, 2.5):
        with pytest.raises(ValueError, match=f"frameskip={wrong} must be a whole number, 1 or more"):
            swm.data.load_dataset(path, frameskip=wrong)  # type: ignore[arg-type]
    assert swm.data.load_dataset(path, frameskip=2.0).frameskip == 2  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"keys_to_load='pixels' is a text; give a list: \['pixels'\]"):
        swm.data.load_dataset(path, keys_to_load="pixels")
