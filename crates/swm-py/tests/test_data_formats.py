"""Every format: written, recognized, read, continued, converted."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from data_makers import LENGTHS, array, episode, write

NATIVE = {"hdf5": "d.h5", "folder": "folder", "video": "video", "lerobot": "lerobot", "mcap": "d.mcap"}
EXACT = ("hdf5", "mcap")
TEXTS = ("hdf5", "folder", "mcap", "video")


@pytest.fixture(params=NATIVE)
def made(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Path]:
    format = request.param
    return format, write(tmp_path / NATIVE[format], format, text=format in TEXTS)


def test_texts_of_rows_are_copied_as_they_are(tmp_path: Path) -> None:
    rows = [["a", "b", "c"], ["d", "e"], ["f", "g", "h"]]
    for name, texts in (("first.h5", rows[:1]), ("second.h5", rows[1:])):
        with swm.data.HDF5Writer(tmp_path / name) as writer:
            for task in texts:
                writer.write_episode({"action": np.zeros((len(task), 2), np.float32), "task": task})
    out = tmp_path / "all.h5"
    for mode in ("overwrite", "append"):
        swm.data.merge([tmp_path / "first.h5", tmp_path / "second.h5"], out, mode=mode, progress=False)
    dataset = swm.data.load_dataset(out, num_steps=2)
    assert list(dataset.get_col_data("task")) == sum(rows, []) * 2
    assert dataset[1]["task"] == "b" and dataset.load_episode(1)["task"] == "d", "a clip has the text of its first row"


def test_round_trip(made: tuple[str, Path]) -> None:
    format, path = made
    dataset = swm.data.load_dataset(path)
    assert isinstance(dataset, swm.data.get_format(format).open_reader(path).__class__)
    assert dataset.lengths.tolist() == list(LENGTHS)
    assert dataset.offsets.tolist() == [0, 10, 17]
    for seed, length in enumerate(LENGTHS):
        wanted, found = episode(length, seed), dataset.load_episode(seed)
        pixels = array(found["pixels"])
        assert pixels.dtype == np.uint8 and pixels.shape == (length, 3, 32, 32)
        difference = np.abs(pixels.transpose(0, 2, 3, 1).astype(int) - wanted["pixels"])
        assert difference.max() <= (0 if format in EXACT else 24)
        for key in ("action", "state", "count", "done"):
            np.testing.assert_allclose(array(found[key]), wanted[key], rtol=1e-6, err_msg=key)
        if format in TEXTS:
            assert found["env_name"] == f"toy{seed}"


def test_clips_have_the_shapes_of_the_reference(made: tuple[str, Path]) -> None:
    _, path = made
    dataset = swm.data.load_dataset(path, num_steps=3, frameskip=2, keys_to_load=["pixels", "action", "state"])
    # 10 - 6 + 1, 7 - 6 + 1 and 12 - 6 + 1 starts.
    assert len(dataset) == 5 + 2 + 7
    clip = dataset[6]
    assert list(clip) == ["pixels", "action", "state"]
    assert clip["pixels"].shape == (3, 3, 32, 32)
    assert clip["action"].shape == (3, 4)
    assert dataset.clip_indices[6] == (1, 1)
    np.testing.assert_array_equal(array(clip["state"])[:, :2], [[1, 1], [1, 3], [1, 5]])
    np.testing.assert_allclose(array(clip["action"]).reshape(6, 2), episode(7, 1)["action"][1:7], rtol=1e-6)


def test_all_ways_to_a_clip_agree(made: tuple[str, Path]) -> None:
    _, path = made
    dataset = swm.data.load_dataset(path, num_steps=2, frameskip=3)
    indices = [0, 3, len(dataset) - 1, -1]
    together = dataset.__getitems__(indices)
    batch = swm.data.collate(together)
    for at, index in enumerate(indices):
        start = dataset.clip_indices[index]
        chunk = dataset.load_chunk([start[0]], [start[1]], [start[1] + 6])[0]
        alone = dataset[index]
        for key in alone:
            if isinstance(alone[key], str):
                assert alone[key] == together[at][key] == chunk[key] == batch[key][at]
                continue
            np.testing.assert_array_equal(array(alone[key]), array(together[at][key]))
            np.testing.assert_array_equal(array(alone[key]), array(chunk[key]))
            np.testing.assert_array_equal(array(alone[key]), array(batch[key])[at])


@pytest.mark.parametrize("format", NATIVE)
def test_modes(tmp_path: Path, format: str) -> None:
    path = write(tmp_path / NATIVE[format], format, lengths=(4,), text=False)
    with pytest.raises(FileExistsError, match="append"):
        write(path, format, lengths=(4,), text=False, mode="error")
    write(path, format, lengths=(4, 5), text=False)
    assert swm.data.load_dataset(path).lengths.tolist() == [4, 4, 5]
    write(path, format, lengths=(6,), text=False, mode="overwrite")
    assert swm.data.load_dataset(path).lengths.tolist() == [6]
    with pytest.raises(ValueError, match="write mode"):
        write(path, format, mode="nope")


@pytest.mark.parametrize("format", NATIVE)
def test_episodes_that_do_not_fit_are_refused(tmp_path: Path, format: str) -> None:
    path = write(tmp_path / NATIVE[format], format, lengths=(4,), text=False)
    wider = episode(4, 1) | {"action": np.zeros((4, 7), np.float32)}
    del wider["env_name"]
    with pytest.raises(ValueError, match="shape mismatch"), swm.data.get_format(format).open_writer(path) as writer:
        writer.write_episode(wider)
    with pytest.raises(ValueError, match="schema mismatch.*unexpected columns"), swm.data.get_format(format).open_writer(path) as writer:
        writer.write_episode({**episode(4, 1), "more": np.zeros(4)})
    assert swm.data.load_dataset(path).lengths.tolist() == [4]


def test_a_column_of_changing_shape_or_type_is_named(tmp_path: Path) -> None:
    ragged = {"action": [np.zeros(2), np.zeros(2), np.zeros(3)]}
    path = tmp_path / "ragged.h5"
    message = r"column 'action' has the shape \(2,\) at step 0 and \(3,\) at step 2"
    with pytest.raises(ValueError, match=message), swm.data.HDF5Writer(path) as writer:
        writer.write_episode(ragged)
    assert not path.exists(), "nothing was recorded"
    with pytest.raises(swm.SwmError, match=r"column `action` is float64 \[2\] a step, and float32 \[2\] in the episodes before"):
        with swm.data.HDF5Writer(path) as writer:
            writer.write_episode({"action": np.zeros((3, 2), np.float32)})
            writer.write_episode({"action": np.zeros((3, 2))})
    assert len(swm.data.load_dataset(path).lengths) == 1


@pytest.mark.parametrize("source", NATIVE)
@pytest.mark.parametrize("target", ["hdf5", "folder", "mcap"])
def test_conversions_keep_the_columns(tmp_path: Path, source: str, target: str) -> None:
    path = write(tmp_path / f"source-{NATIVE[source]}", source, text=False)
    swm.data.convert(path, tmp_path / NATIVE[target], dest_format=target, progress=False)
    before, after = swm.data.load_dataset(path), swm.data.load_dataset(tmp_path / NATIVE[target])
    assert after.lengths.tolist() == list(LENGTHS)
    assert set(before.column_names) == set(after.column_names)
    np.testing.assert_array_equal(after.get_col_data("action"), before.get_col_data("action"))
    np.testing.assert_array_equal(after.get_col_data("state"), before.get_col_data("state"))


def test_a_conversion_equals_that_of_the_command(tmp_path: Path) -> None:
    source = write(tmp_path / "a.h5")
    swm.data.convert(source, tmp_path / "python.mcap", progress=False)
    command = [sys.executable, "-m", "stable_worldmodel_rs", "convert", str(source), str(tmp_path / "command.mcap")]
    subprocess.run(command, check=True, capture_output=True)
    assert (tmp_path / "python.mcap").read_bytes() == (tmp_path / "command.mcap").read_bytes()


def test_a_conversion_shows_progress_and_may_be_stopped(tmp_path: Path) -> None:
    source = write(tmp_path / "a.h5", lengths=(5,) * 4)
    told: list[int] = []
    from stable_worldmodel_rs import _swm

    def to(name: str) -> str:
        return json.dumps({"source": str(source), "target": str(tmp_path / name)})

    made, notes = _swm.run_request("convert", to("b.h5"), lambda _, total, unit: told.append(-total), lambda rows, *_: told.append(rows))
    assert (json.loads(made)["episodes"], json.loads(made)["rows"], notes) == (4, 20, [])
    counts = told[told.index(-20) + 1 :]
    assert counts and counts == sorted(counts) and counts[-1] == 20
    # Once more: they are all there.
    again = json.loads(_swm.run_request("convert", to("b.h5"))[0])
    assert (again["resumed"], again["rows"]) == (4, 0)

    def stop(*_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _swm.run_request("convert", to("c.h5"), None, stop)


def test_lerobot_has_an_action_in_every_row_and_texts_of_tasks(tmp_path: Path) -> None:
    columns = episode(5, 0)
    columns["action"][-1] = np.nan
    columns["task"] = ["push the block"] * 5
    frames = {}
    for last_row in ("drop", "keep"):
        path = tmp_path / last_row
        with swm.data.LeRobotWriter(path, last_row=last_row) as writer:
            writer.write_episode(columns)
        frames[last_row] = json.loads((path / "meta/info.json").read_text())["total_frames"]
        dataset = swm.data.load_dataset(path)
        assert dataset.lengths.tolist() == [5]
        np.testing.assert_array_equal(array(dataset.load_episode(0)["action"]), columns["action"])
        assert dataset.get_col_data("task")[-1] == "push the block"
    assert frames == {"drop": 4, "keep": 5}
    with pytest.raises(ValueError, match="drop or keep"), swm.data.LeRobotWriter(tmp_path / "c", last_row="both"):
        pass
    swm.data.convert(tmp_path / "drop", tmp_path / "again", dest_format="lerobot", last_row="keep", progress=False)
    assert json.loads((tmp_path / "again/meta/info.json").read_text())["total_frames"] == 5


def test_merging(tmp_path: Path) -> None:
    first, second = write(tmp_path / "a.h5", lengths=(4, 5)), write(tmp_path / "b.mcap", "mcap", lengths=(6,))
    out = tmp_path / "out.h5"
    swm.data.merge([first, second], out, progress=False)
    merged = swm.data.load_dataset(out)
    assert merged.lengths.tolist() == [4, 5, 6]
    np.testing.assert_array_equal(array(merged.load_episode(2)["action"]), episode(6, 0)["action"])
    with pytest.raises(FileExistsError):
        swm.data.merge([first, second], out, progress=False)
    swm.data.merge([first, second], out, mode="append", progress=False)
    assert swm.data.load_dataset(out).lengths.tolist() == [4, 5, 6] * 2
    swm.data.merge([second, first], out, mode="overwrite", progress=False)
    assert swm.data.load_dataset(out).lengths.tolist() == [6, 4, 5]
    with pytest.raises(ValueError, match="at least two"):
        swm.data.merge([first], out)
    other = write(tmp_path / "c.h5", text=False)
    with pytest.raises(ValueError, match=r"column mismatch.*missing \['env_name'\]"):
        swm.data.merge([first, other], tmp_path / "d.h5", progress=False)


def test_formats_of_python_code(tmp_path: Path) -> None:
    class Pickled(swm.data.Format):
        name = "pickled"

        @classmethod
        def detect(cls, path: str | Path) -> bool:
            return Path(path).suffix == ".pkl"

        @classmethod
        def open_reader(cls, path: str | Path, **kwargs: object) -> swm.data.ReplayBuffer:
            buffer = swm.data.ReplayBuffer(1000)
            buffer.write_episodes(pickle.loads(Path(path).read_bytes()))
            return buffer

        @classmethod
        def open_writer(cls, path: str | Path, **kwargs: object) -> object:
            class Writer:
                def __enter__(self) -> Writer:
                    self.kept: list[object] = []
                    return self

                def __exit__(self, *exc: object) -> None:
                    Path(path).write_bytes(pickle.dumps(self.kept))

                def write_episodes(self, episodes: object) -> None:
                    self.kept.extend(episodes)  # type: ignore[arg-type]

            return Writer()

    swm.data.register_format(Pickled)
    try:
        source = write(tmp_path / "a.h5", text=False)
        swm.data.convert(source, tmp_path / "a.pkl", dest_format="pickled", progress=False)
        loaded = swm.data.load_dataset(tmp_path / "a.pkl")
        assert loaded.lengths.tolist() == list(LENGTHS)
        swm.data.convert(tmp_path / "a.pkl", tmp_path / "b.h5", progress=False)
        again = swm.data.load_dataset(tmp_path / "b.h5")
        np.testing.assert_array_equal(again.get_col_data("pixels"), swm.data.load_dataset(source).get_col_data("pixels"))
        with pytest.raises(TypeError, match="DataLoader"):
            swm.data.Loader(swm.data.Dataset(np.array([3]), np.array([0])))
        with pytest.raises(ValueError, match="already registered"):
            swm.data.register_format(Pickled)
    finally:
        del swm.data.FORMATS["pickled"]


def test_types_are_kept_or_widened(tmp_path: Path) -> None:
    kinds = {"bool": "bool", "uint8": "uint8", "int8": "int32", "uint16": "int32", "int32": "int32", "uint32": "int64",
             "int64": "int64", "uint64": "int64", "float16": "float32", "float32": "float32", "float64": "float64"}
    with swm.data.HDF5Writer(tmp_path / "a.h5") as writer:
        writer.write_episode({name: np.ones((3, 2), name) for name in kinds})
    dataset = swm.data.load_dataset(tmp_path / "a.h5")
    assert {name: dataset.get_col_data(name).dtype.name for name in kinds} == kinds
    with pytest.raises(TypeError, match="complex128"), swm.data.HDF5Writer(tmp_path / "b.h5") as writer:
        writer.write_episode({"z": np.ones(3, complex)})
    with pytest.raises(ValueError, match="range of int64"), swm.data.HDF5Writer(tmp_path / "b.h5") as writer:
        writer.write_episode({"z": np.full(3, 2**63, np.uint64)})


def test_unknown_names_say_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="unknown format 'nope'; available: .*'hdf5'"):
        swm.data.get_format("nope")
    if "lance" not in swm.data.list_formats():
        with pytest.raises(ValueError, match="swm convert"):
            swm.data.get_format("lance")
        with pytest.raises(swm.DataError, match="HDF5Dataset"):
            swm.data.LanceDataset("x")
    with pytest.raises(FileNotFoundError, match=r"swm\.data\.download\('user/repo'\)"):
        swm.data.load_dataset("user/repo", cache_dir=tmp_path)
    with pytest.raises(FileNotFoundError):
        swm.data.load_dataset(tmp_path / "nothing.h5", format="hdf5")
    (tmp_path / "x.weird").touch()
    (tmp_path / "mine" / "data").mkdir(parents=True)
    (tmp_path / "mine" / "data" / "metadata.json").write_text("{}")
    with pytest.raises(ValueError, match=r"a Minari dataset, which is not read yet; .* `HDF5Writer`"):
        swm.data.load_dataset(tmp_path / "mine")
    with pytest.raises(ValueError, match="No format detected"):
        swm.data.load_dataset(tmp_path / "x.weird")
    (tmp_path / "x.h5").write_bytes(b"not this")
    with pytest.raises(swm.DataError, match=r"x\.h5"):
        swm.data.load_dataset(tmp_path / "x.h5")


@pytest.mark.skipif("lance" not in swm.data.list_formats(), reason="a wheel without Lance")
def test_lance_keeps_what_an_episode_has_once(tmp_path: Path) -> None:
    def episode(steps: int, **once: object) -> dict[str, object]:
        columns = {"pixels": np.zeros((steps, 8, 8, 3), np.uint8), "action": np.ones((steps, 2), np.float32)}
        return columns | ({swm.data.EPISODE_DATA_KEY: once} if once else {})

    path = tmp_path / "demo.lance"
    with swm.data.LanceWriter(path) as writer:
        writer.write_episode(episode(3, scene="<a/>", number=4, size=np.ones(2)))
    with swm.data.LanceWriter(path) as writer:
        writer.write_episode(episode(2, scene="<b/>", number=5, size=np.zeros(2)))
        with pytest.raises(ValueError, match="episode-data key mismatch"):
            writer.write_episode(episode(2))
        with pytest.raises(TypeError, match="'scene' is bytes"):
            writer.write_episode(episode(2, scene=b"<c/>", number=5, size=np.zeros(2)))
    dataset = swm.data.load_dataset(tmp_path)
    assert dataset.episode_column_names == ["number", "scene", "size"]
    assert sorted(dataset.column_names) == ["action", "pixels"]
    data = dataset.get_episode_data([1, 0])
    assert (data["number"], data["scene"]) == ([5, 4], ["<b/>", "<a/>"])
    assert [size.tolist() for size in data["size"]] == [[0, 0], [1, 1]]
    swm.data.merge([path, path], tmp_path / "twice.lance")
    assert swm.data.load_dataset(tmp_path / "twice.lance").get_episode_data()["number"] == [4, 5, 4, 5]
    with swm.data.LanceWriter(path, mode="overwrite") as writer:
        writer.write_episode(episode(2))
    assert swm.data.load_dataset(path).episode_column_names == []
    with swm.data.LanceWriter(path) as writer, pytest.raises(ValueError, match="Regenerate"):
        writer.write_episode(episode(2, number=1))


def test_download_needs_the_hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, object] = {}

    class Hub:
        @staticmethod
        def snapshot_download(repo: str, **options: object) -> None:
            asked.update(options, repo=repo)
            write(Path(str(options["local_dir"])) / "a.h5", lengths=(4,))

    from stable_worldmodel_rs.data import utils

    monkeypatch.setattr(utils.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match="pip install huggingface_hub"):
        swm.data.download("user/repo", cache_dir=tmp_path)
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "huggingface_hub", Hub)
    monkeypatch.setattr(utils.importlib.util, "find_spec", lambda name: object())
    folder = swm.data.download("user/repo", cache_dir=tmp_path)
    monkeypatch.undo()
    assert folder == tmp_path / "datasets" / "user--repo" and asked["repo_type"] == "dataset"
    assert swm.data.load_dataset("user/repo", cache_dir=tmp_path).lengths.tolist() == [4]
