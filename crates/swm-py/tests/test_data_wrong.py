"""Datasets that users get wrong: what is written as it should not be, and what is opened and is none."""

from __future__ import annotations

import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm

LOGGER = "stable_worldmodel_rs"
STATES = np.zeros((4, 2), np.float32)
IMAGES = np.zeros((4, 32, 32, 3), np.uint8)


def write(path: Path, episode: Any = None, cls: Any = swm.data.HDF5Writer, **options: Any) -> None:
    with cls(path, **options) as writer:
        writer.write_episode({"state": STATES, "action": STATES, "pixels": IMAGES} if episode is None else episode)


# ---- a dataset that exists


WRITERS = {
    "a.h5": swm.data.HDF5Writer,
    "folder": swm.data.FolderWriter,
    "video": swm.data.VideoWriter,
    "a.mcap": swm.data.McapWriter,
    "robot": swm.data.LeRobotWriter,
}


@pytest.mark.parametrize("name", WRITERS)
def test_appending_by_default_is_noted_once(name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path, cls = tmp_path / name, WRITERS[name]
    with caplog.at_level(logging.WARNING, logger=LOGGER):
        write(path, cls=cls)
        assert caplog.messages == []
        with cls(path) as writer:
            for _ in range(2):
                writer.write_episode({"state": STATES, "action": STATES, "pixels": IMAGES})
        [noted] = caplog.messages
        assert f"{path} exists, with 1 episodes before this: new ones are appended, which is the default" in noted
        assert "mode='append' to do so without this warning" in noted and "mode='overwrite'" in noted
        caplog.clear()
        write(path, cls=cls, mode="append")
        assert caplog.messages == []
    assert len(swm.data.load_dataset(path).lengths) == 4


# ---- objects


def per_step(value: Any) -> dict[str, Any]:
    return {"state": STATES, "info": [value] * 4}


OBJECTS: list[tuple[dict[str, Any], str]] = [
    (per_step(None), r"column 'info' is None at step 0; leave the column out, or .*NaN for floats"),
    ({"info": None}, "column 'info' is None; leave the column out"),
    ({"info": [1.0, None, 2.0, 3.0]}, "column 'info' is None at step 1"),
    (per_step(object()), r"column 'info' holds object at step 0, and datasets hold numbers and text; .*str\(value\)"),
    (per_step(Path("a")), "column 'info' holds (Posix|Windows)Path at step 0"),
    (per_step([1, None]), "column 'info' holds list at step 0"),
    ({"info": np.array([1, 2, None, {}], dtype=object)}, "column 'info' is None at step 2"),
    ({"info": {1, 2}}, "column 'info' holds set"),
    ({"info": object()}, "column 'info' holds object, and"),
    ({"info": ["a", 1, "b", 2]}, "column 'info' holds text at step 0 and int at step 1; give numbers at every step, or text"),
    ({"info": [{"a": 1}, None, {"a": 2}, {"a": 3}]}, "column 'info' holds dict at step 0, .*give a dict at every step"),
    ({"info": [{"a": 1}, {"b": 2}]}, r"column 'info': the dict of step 1 has other keys than that of step 0 \(a, b\)"),
    ({"info": 3.0}, r"column 'info' is the single value 3.0; give one per step: \[3.0\] \* T"),
    ({"task": "push"}, r"column 'task' is the single value 'push'; give one per step: \['push'\] \* T"),
    ({"info": np.array([["a", "b"]] * 4)}, r"column 'info' is text of shape \[4, 2\]; datasets hold one text per step"),
    ({"info": [b"\xff\xfe"] * 4}, "column 'info' holds bytes that are no text of UTF-8"),
    ({3: STATES}, "the column 3 has a name that is int"),
    ([{"state": STATES}], "an episode is a dict .*found list; write several by write_episodes"),  # type: ignore[list-item]
]


@pytest.mark.parametrize(("episode", "message"), OBJECTS)
def test_objects_are_refused_by_name(episode: Any, message: str, tmp_path: Path) -> None:
    if isinstance(episode, dict) and not any(isinstance(name, int) for name in episode):
        episode = {"state": STATES, **episode}
    with pytest.raises(TypeError, match=message):
        write(tmp_path / "a.h5", episode)
    assert not (tmp_path / "a.h5").exists()


def test_masked_values_are_not_written(tmp_path: Path) -> None:
    values = np.ma.masked_array(np.arange(4.0), mask=[False, True, False, False])
    for column in (values, [values[0:2], values[2:4], values[0:2], values[2:4]]):
        with pytest.raises(TypeError, match=r"column 'x' is a masked array.*values.filled\(np.nan\)"):
            write(tmp_path / "a.h5", {"x": column})
    write(tmp_path / "a.h5", {"x": values.filled(np.nan), "y": np.ma.masked_array(np.arange(4.0), mask=False)})
    assert np.isnan(swm.data.load_dataset(tmp_path / "a.h5").get_col_data("x")).tolist() == [False, True, False, False]


OPENING = {
    "image_size=(-1, 3)": ({"image_size": (-1, 3)}, ValueError, r"image_size=\(-1, 3\): give sides of 1 pixel or more"),
    "image_size=(64,)": ({"image_size": (64,)}, TypeError, r"image_size=\(64,\): give the height and width"),
    "image": ({"image": (-1, 3)}, ValueError, r"image=\(-1, 3\): give sides of 1 pixel or more"),
    "image_size=64": ({"image_size": 64}, TypeError, "image_size=64: give the height and width"),
    "fit": ({"image_size": (8, 8), "fit": "crp"}, ValueError, "fit='crp'; use 'stretch' or 'crop' or 'pad'"),
    "flip": ({"flip": "up"}, ValueError, "flip='up'; use 'vertical' or '180'"),
    "channels": ({"channels": "gbr"}, ValueError, "channels='gbr'; use 'rgb' or 'bgr'"),
    "fps": ({"fps": "10"}, TypeError, "fps='10': give a number of rows per second"),
    "fps=0": ({"fps": 0}, ValueError, "fps=0: give a finite number above 0"),
    "camera": ({"camera": 0}, TypeError, "camera=0: give text, such as camera='top'"),
    "map": ({"map": [("a", "b")]}, TypeError, r"map=.*: give a dict, such as map=\{'proprio': 'obs.state'\}"),
    "shift": ({"shift": 2}, ValueError, "shift=2: give a whole number from 0 to 1"),
    "max_steps": ({"max_steps": -1}, ValueError, "max_steps=-1: give 1 or more"),
    "options": ({"options": {"camra": "top"}}, ValueError, r"has no option 'camra' \(did you mean 'camera'\?\)"),
}


@pytest.mark.parametrize("what", OPENING)
def test_options_of_opening_are_named_in_errors(what: str, tmp_path: Path) -> None:
    options, kind, message = OPENING[what]
    write(tmp_path / "a.h5")
    with pytest.raises(kind, match=message) as caught:
        swm.data.load_dataset(tmp_path / "a.h5", **options)
    assert "line 1" not in str(caught.value)


def test_what_is_no_dataset_is_an_error_of_datasets(tmp_path: Path) -> None:
    with pytest.raises(swm.DataError, match="No format detected; .* is not a dataset: it is an empty folder"):
        swm.data.load_dataset(tmp_path)


def test_options_that_are_none_are_left_out(tmp_path: Path) -> None:
    write(tmp_path / "a.h5")
    opened = swm.data.load_dataset(tmp_path / "a.h5", camera=None, map=None, image_size=(np.int64(8), 8))
    assert tuple(opened[0]["pixels"].shape) == (1, 3, 8, 8)


def test_episodes_and_rows_that_are_not_there_are_named(tmp_path: Path) -> None:
    write(tmp_path / "a.h5", {"state": np.arange(8.0).reshape(4, 2)})
    write(tmp_path / "a.h5", {"state": np.arange(8.0).reshape(4, 2) + 8}, mode="append")
    dataset = swm.data.load_dataset(tmp_path / "a.h5")
    assert np.asarray(dataset.load_episode(-1)["state"])[0].tolist() == [8, 9]
    for number in (2, -3):
        with pytest.raises(IndexError, match=f"there is no episode {number}; there are 2, counted from 0"):
            dataset.load_episode(number)
    with pytest.raises(swm.DataError, match="load_chunk: rows 3 to 1 of episode 0, which has 4 rows"):
        dataset.load_chunk([0], [3], [1])
    with pytest.raises(ValueError, match="load_chunk: 1, 2, 1 episodes, starts and ends"):
        dataset.load_chunk([0], [0, 1], [2])


def test_dicts_become_columns_as_in_recordings(tmp_path: Path) -> None:
    arm = np.arange(8, dtype=np.float32).reshape(4, 2)
    steps = [{"force": float(step), "hand": {"open": step % 2 == 0}} for step in range(4)]
    write(tmp_path / "a.h5", {"obs": {"arm": arm, "task": ["push"] * 4}, "info": steps})
    dataset = swm.data.load_dataset(tmp_path / "a.h5")
    assert set(dataset.column_names) >= {"obs.arm", "obs.task", "info.force", "info.hand.open"}
    assert np.array_equal(dataset.get_col_data("obs.arm"), arm)
    assert dataset.get_col_data("info.force").tolist() == [0, 1, 2, 3]
    assert dataset.get_col_data("info.hand.open").tolist() == [True, False, True, False]
    assert dataset.get_col_data("obs.task").tolist() == ["push"] * 4


def test_values_of_an_episode_are_left_out_by_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, logger=LOGGER), swm.data.HDF5Writer(tmp_path / "a.h5") as writer:
        for _ in range(2):
            writer.write_episode({"state": STATES, swm.data.EPISODE_DATA_KEY: {"scene": 3}})
    assert [message for message in caplog.messages if "['scene'] are left out" in message] == caplog.messages != []


# ---- metadata


def test_the_environment_of_metadata_is_compared_with_known_ones(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    import gymnasium  # noqa: F401  its ids are known then

    def noted(env: Any) -> list[str]:
        caplog.clear()
        with caplog.at_level(logging.WARNING, logger=LOGGER):
            write(tmp_path / "a.h5", mode="overwrite", metadata={"env": env})
        assert swm.data.load_dataset(tmp_path / "a.h5").metadata["env"] == env
        return caplog.messages

    for wrong, meant in [("swm/PushTT-v1", "'swm/PushT-v1'"), ("swm_rs/TwoRom-v2", "'swm_rs/TwoRoom-v2'"), ("swm/Chess-v0", "swm.envs.WORLDS")]:
        with pytest.raises(swm.DataError, match=f"`env` is '{wrong}', which is no environment of this package; .*{meant}.*'mylab/Name-v0'"):
            swm.data.HDF5Writer(tmp_path / "b.h5", metadata={"env": wrong})
    for mine in ("swm/PushT-v1", "swm_rs/PushT-v1", "CartPole-v1", "CartPole-v0", "mylab/PushT-v1", "lab/CartPole-v1", "Chess"):
        assert noted(mine) == [], mine
    for near, meant in [("CartPol-v1", "'CartPole-v1'"), ("PushT", "'swm/PushT-v1'")]:
        [message] = noted(near)
        assert f"`env` is '{near}', which is no known environment; did you mean {meant}?" in message
    for wrong in (3, "", None):
        with pytest.raises(swm.DataError, match=f"`env` is {wrong!r}; give the id of an environment, such as 'swm/PushT-v1'"):
            swm.data.HDF5Writer(tmp_path / "b.h5", metadata={"env": wrong})


def test_metadata_and_quality_that_cannot_be_kept_are_named(tmp_path: Path) -> None:
    for options, message in [
        ({"metadata": "seed=3"}, "metadata is str; give a dict such as"),
        ({"metadata": {"policy": object()}}, "metadata: `policy` is object; give numbers, text"),
        ({"quality": 300}, "quality=300; give 1 to 100"),
    ]:
        with pytest.raises(ValueError, match=message):
            swm.data.HDF5Writer(tmp_path / "a.h5", **options)  # type: ignore[arg-type]
    (tmp_path / "file").write_text("")
    with pytest.raises(swm.DataError, match="file is a file, so that a.h5 cannot be in it"):
        write(tmp_path / "file" / "a.h5")


# ---- what is opened and is no dataset


def videos(folder: Path) -> None:
    for name in ("a.mp4", "b.mp4"):
        _swm.save_video(str(folder / name), IMAGES, 10.0)


def archives(*columns: tuple[str, ...]) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        for number, names in enumerate(columns):
            np.savez(folder / f"{number}.npz", **dict.fromkeys(names, STATES))  # type: ignore[arg-type]

    return make


def of_text(name: str, text: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_text(text) and None


def two_datasets(folder: Path) -> None:
    write(folder / "a.mcap", cls=swm.data.McapWriter)
    write(folder / "b.mcap", cls=swm.data.McapWriter)


def run(folder: Path) -> None:
    (folder / "checkpoints").mkdir()
    (folder / "config.json").write_text("{}")


def manifest(folder: Path) -> None:
    swm.make_manifest(folder / "t.toml", "swm/PushT-v1", episodes=2, seed=0, budget=3)


def binary(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes(b"\x00\xff\x01") and None


NOTHING: dict[str, tuple[str, Callable[[Path], Any], list[str]]] = {
    "empty folder": ("", lambda _: None, ["it is an empty folder", "give the file or folder of a dataset"]),
    "videos": ("", videos, ["it holds 2 videos (a.mp4, b.mp4)", "no actions, no states", "`HDF5Writer`"]),
    "archives": ("", archives(("x", "y"), ("x", "y")), ["2 archives of NumPy (x, y in each)", "write_episode(dict(numpy.load(file)))"]),
    "other archives": ("", archives(("x",), ("x", "y")), ["different columns: 0.npz has x, and 1.npz has x, y", "the same columns"]),
    "bad archive": ("", binary("0.npz"), ["0.npz cannot be read"]),
    "arrays": ("", lambda folder: np.save(folder / "a.npy", STATES), ["1 arrays of NumPy (a.npy)", "numpy.load"]),
    "images": ("", binary("a.png"), ["1 images (a.png), without actions"]),
    "weights": ("", binary("a.pt"), ["weights of a model (a.pt)", "`swm.load_pretrained`"]),
    "run": ("", run, ["a run of `swm train`, which holds a model and no episodes"]),
    "datasets": ("", two_datasets, ["it holds datasets (a.mcap, b.mcap)", "`swm.data.merge`"]),
    "others": ("", of_text("a.xyz", "1"), ["it holds a.xyz, and nothing of a known format"]),
    "text": ("a.txt", of_text("a.txt", "hello\n"), ["it is a file of text, which begins with 'hello'"]),
    "table": ("a.csv", of_text("a.csv", "x,y\n1,2\n"), ["it is a table of text", "pandas.read_csv"]),
    "manifest": ("t.toml", manifest, ["it is a manifest of evaluations; `swm.read_manifest`"]),
    "receipt": ("receipt.json", of_text("receipt.json", '{"candidate": {}}'), ["it is the receipt of an evaluation; `swm.read_receipt`"]),
    "video": ("a.mp4", videos, ["it is a video, without actions and states"]),
    "image": ("a.png", binary("a.png"), ["it is one image"]),
    "packed": ("a.zip", binary("a.zip"), ["it is a packed archive; unpack it"]),
    "pickle": ("a.pkl", binary("a.pkl"), ["it is a pickle of Python", "which is not read"]),
}


@pytest.mark.parametrize("what", NOTHING)
def test_what_is_no_dataset_is_named(what: str, tmp_path: Path) -> None:
    name, make, words = NOTHING[what]
    (tmp_path / "it").mkdir()
    make(tmp_path / "it")
    path = tmp_path / "it" / name if name else tmp_path / "it"
    with pytest.raises(ValueError, match="No format detected") as caught:
        swm.data.load_dataset(path)
    message = str(caught.value)
    assert f"{path} is not a dataset: " in message
    assert not [word for word in words if word not in message], message


def test_names_that_are_no_paths_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STABLEWM_HOME", str(tmp_path / "home"))
    for wrong, message in [
        (None, "load_dataset was given NoneType None in the place of a path"),
        (["a.h5", "b.h5"], "was given list .*join several by ConcatDataset"),
        (3, "was given int 3"),
    ]:
        with pytest.raises(TypeError, match=message):
            swm.data.load_dataset(wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="given an empty name"):
        swm.data.load_dataset("")
    for url in ("gs://bucket/a.h5", "ftp://host/a"):
        with pytest.raises(ValueError, match=r"of schemes, https://, s3://, hf://datasets/ and lerobot:// are known"):
            swm.data.load_dataset(url)
    write(tmp_path / "pusht.h5")
    with pytest.raises(FileNotFoundError, match=r"did you mean '.*pusht.h5'\?"):
        swm.data.load_dataset(tmp_path / "push.h5")
    with pytest.raises(FileNotFoundError, match="there is no folder .*data"):
        swm.data.load_dataset(tmp_path / "data" / "pusht.h5")
    with pytest.raises(TypeError, match="load_dataset has no argument 'num_step'; did you mean 'num_steps'?"):
        swm.data.load_dataset(tmp_path / "pusht.h5", num_step=3)
    with pytest.raises(ValueError, match=r"unknown format 'hdf'; .*did you mean 'hdf5'\?"):
        swm.data.load_dataset(tmp_path / "pusht.h5", format="hdf")
    with pytest.raises(ValueError, match="pusht.h5 is a file, and a LeRobot dataset is a folder"):
        swm.data.load_dataset(tmp_path / "pusht.h5", format="lerobot")
    # Reading makes no folder.
    assert not (tmp_path / "home").exists()


# ---- files that may not be read or written


@contextmanager
def as_a_user() -> Iterator[None]:
    """Not as root, who may do everything."""
    if os.geteuid() != 0:
        yield
        return
    os.setegid(65534)
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)
        os.setegid(0)


@pytest.fixture
def shared() -> Iterator[Path]:
    """A folder that every user can enter, with a dataset and a manifest, a file that may not be read and a folder that may not be written."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    write(folder / "open.h5")
    manifest(folder)
    shutil.copy(folder / "open.h5", folder / "secret.h5")
    (folder / "secret.h5").chmod(0)
    (folder / "kept").mkdir()
    (folder / "kept").chmod(0o555)
    yield folder
    shutil.rmtree(folder)


def record(folder: Path) -> None:
    live = swm.World("swm/PushT-v1", num_envs=1, add_pixels=False, max_episode_steps=3, threads=1)
    live.set_policy("random")
    live.collect(folder / "kept" / "a.h5", episodes=1, seed=0, progress=False)


DENIED: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "load": ("secret.h5", lambda folder: swm.data.load_dataset(folder / "secret.h5")),
    "verify": ("secret.h5", lambda folder: swm.data.verify(folder / "secret.h5", progress=False)),
    "write": ("kept/a.h5", lambda folder: write(folder / "kept" / "a.h5")),
    "write folder": ("kept/a", lambda folder: write(folder / "kept" / "a", cls=swm.data.FolderWriter)),
    "write below": ("kept/b", lambda folder: write(folder / "kept" / "b" / "a.h5")),
    "append": ("secret.h5", lambda folder: write(folder / "secret.h5", mode="append")),
    "convert": ("kept/a.h5", lambda folder: swm.data.convert(folder / "open.h5", folder / "kept" / "a.h5", progress=False)),
    "record": ("kept/a.h5", record),
    "manifest": ("kept/t.toml", lambda folder: manifest(folder / "kept")),
    "evaluate": ("kept/out", lambda folder: swm.evaluate(folder / "t.toml", "random", folder / "kept" / "out", references=[], progress=False)),
    "cache": ("kept/home", lambda folder: swm.data.get_cache_dir(folder / "kept" / "home")),
}


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of POSIX")
@pytest.mark.parametrize("what", DENIED)
def test_denied_access_is_one_error(what: str, shared: Path) -> None:
    place, call = DENIED[what]
    with as_a_user(), pytest.raises(swm.FilePermissionError) as caught:
        call(shared)
    assert isinstance(caught.value, (swm.DataError, PermissionError))
    assert str(caught.value).startswith(f"{shared / place}: permission denied; give a place that you may read and write"), caught.value


def test_a_dataset_is_read_where_no_folder_can_be_made(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STABLEWM_HOME", str(shared / "kept" / "home"))
    with as_a_user():
        assert len(swm.data.load_dataset(shared / "open.h5").lengths) == 1
