"""Recordings of Rerun: what its library is given, and what it reads back where it is installed."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import stable_worldmodel_rs as swm

EPISODE = {
    "pixels": np.arange(3 * 4 * 5 * 3, dtype=np.uint8).reshape(3, 4, 5, 3),
    "action": np.arange(6, dtype=np.float32).reshape(3, 2),
    "done": np.array([False, False, True]),
    "task": np.array(["push", "push", "push"], dtype=object),
    "state": np.zeros((3, 65)),
}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "episode.rrd"


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> dict[str, tuple[dict[str, Any], Any]]:
    """A library that keeps what each entity is sent: timelines by name, and the content."""
    found: dict[str, tuple[dict[str, Any], Any]] = {}

    class Recording:
        def __init__(self, name: str) -> None: ...

        def save(self, path: Path) -> None:
            Path(path).write_bytes(b"")

        def send_columns(self, entity: str, indexes: list[dict[str, Any]], content: Any) -> None:
            found[entity] = ({name: values for index in indexes for name, values in index.items()}, content)

        def disconnect(self) -> None: ...

    class Columns(list[Any]):
        def partition(self, lengths: list[int]) -> Columns:
            self.lengths = lengths
            return self

    class Named:
        def __getattr__(self, name: str) -> Any:
            if name.isupper() or name == "U8":
                return name
            return lambda **values: values

    rerun = ModuleType("rerun")
    rerun.RecordingStream = Recording  # type: ignore[attr-defined]
    rerun.TimeColumn = lambda name, **values: {name: next(iter(values.values()))}  # type: ignore[attr-defined]
    rerun.Scalars = type("Scalars", (), {"columns": staticmethod(lambda scalars: Columns(scalars.tolist()))})  # type: ignore[attr-defined]
    rerun.Image = type("Image", (), {"columns": staticmethod(lambda **values: values)})  # type: ignore[attr-defined]
    rerun.ColorModel = rerun.ChannelDatatype = rerun.components = Named()  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "rerun", rerun)
    return found


def test_images_and_numbers_are_sent_by_step_and_the_rest_is_named(
    file: Path, sent: dict[str, tuple[dict[str, Any], Any]], caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level("INFO", logger="stable_worldmodel_rs"):
        assert swm.data.to_rerun(EPISODE, file, fps=10) == file
    assert list(sent) == ["pixels", "action", "done"]
    assert "left out state, task" in caplog.text
    timelines, images = sent["pixels"]
    assert timelines["step"].tolist() == [0, 1, 2]
    assert timelines["time"].tolist() == [0.0, 0.1, 0.2]
    assert images["buffer"].tolist() == EPISODE["pixels"].reshape(3, -1).tolist()
    assert images["format"][0] == {"width": 5, "height": 4, "color_model": "RGB", "channel_datatype": "U8"}
    assert sent["action"][1] == [0, 1, 2, 3, 4, 5]
    assert sent["action"][1].lengths == [2, 2, 2]
    assert sent["done"][1] == [0, 0, 1]


def test_channels_first_are_turned(file: Path, sent: dict[str, tuple[dict[str, Any], Any]]) -> None:
    swm.data.to_rerun({"pixels": EPISODE["pixels"].transpose(0, 3, 1, 2)}, file)
    assert sent["pixels"][1]["buffer"].tolist() == EPISODE["pixels"].reshape(3, -1).tolist()
    assert list(sent["pixels"][0]) == ["step"]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"columns": ["reward"]}, "there is no 'reward'; there are pixels, action"),
        ({"columns": ["task"]}, "nothing to show"),
        ({"episodes": [0]}, "leave it out for arrays"),
        ({"fps": 0}, "fps=0 must be above 0"),
    ],
)
def test_wrong_arguments_are_named_and_leave_no_file(
    file: Path, sent: dict[str, tuple[dict[str, Any], Any]], options: dict[str, Any], text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        swm.data.to_rerun(EPISODE, file, **options)
    assert not list(file.parent.iterdir())


def test_a_name_of_another_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"end it with \.rrd"):
        swm.data.to_rerun(EPISODE, tmp_path / "episode.mcap")


def test_a_missing_library_is_named_with_its_installation(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ImportError, match="pip install rerun-sdk"):
        swm.data.to_rerun(EPISODE, file)


def recorded(tmp_path: Path, name: str) -> Any:
    world = swm.World("swm/PushT-v1", num_envs=1, max_episode_steps=5, image_shape=(16, 16))
    world.set_policy(swm.RandomPolicy(seed=1))
    world.collect(tmp_path / name, episodes=2, seed=1, progress=False)
    return swm.data.load_dataset(tmp_path / name)


def test_episodes_of_a_dataset_are_entities(
    tmp_path: Path, file: Path, sent: dict[str, tuple[dict[str, Any], Any]]
) -> None:
    dataset = recorded(tmp_path, "pusht.h5")
    swm.data.to_rerun(dataset, file, episodes=[1], columns=["pixels", "action"])
    assert list(sent) == ["episode_1/pixels", "episode_1/action"]
    assert len(sent["episode_1/pixels"][1]["buffer"]) == int(dataset.lengths[1])
    with pytest.raises(ValueError, match=r"there is no 2; there are 0 to 1"):
        swm.data.to_rerun(dataset, file, episodes=[2])


@pytest.mark.skipif(find_spec("rerun") is None, reason="rerun-sdk is not installed")
def test_rerun_reads_what_was_written(tmp_path: Path, file: Path) -> None:
    from rerun.chunk import McapReader, RrdReader  # pyright: ignore[reportMissingImports]

    def batches(reader: Any) -> dict[str, list[Any]]:
        found: dict[str, list[Any]] = {}
        for chunk in reader:
            found.setdefault(str(chunk.entity_path), []).append(chunk.to_record_batch())
        return found

    dataset = recorded(tmp_path, "pusht.mcap")
    swm.data.to_rerun(dataset, file)
    [actions] = batches(RrdReader(file).store().stream())["/episode_0/action"]
    expected = np.asarray(dataset.load_episode(0)["action"], dtype=np.float64)
    np.testing.assert_array_equal(actions.column("Scalars:scalars").to_pylist(), expected)
    # And our MCAP files as its own importer reads them: an image for each row.
    images = [batch for batch in batches(McapReader(tmp_path / "pusht.mcap").stream())["/pixels"] if "EncodedImage:blob" in batch.schema.names]
    assert sum(batch.num_rows for batch in images) == int(dataset.lengths.sum())
