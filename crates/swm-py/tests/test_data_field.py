"""Published datasets of other programs, opened where they are."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import stable_worldmodel_rs as swm

FIELD = Path(__file__).parents[3] / "tests" / "golden" / "field"


def test_datasets_of_other_programs_open() -> None:
    dataset = swm.data.load_dataset(FIELD / "dinowm_pusht_noise")
    assert dataset.metadata["env"] == "swm/PushT-v1"
    assert dataset.lengths.tolist() == [12, 9]
    assert dataset.mapping["action"] == "rel_actions.pth / 100"
    assert np.abs(dataset.get_col_data("action")).max() < 1
    wrist = swm.data.load_dataset(FIELD / "robomimic_can.hdf5", camera="robot0_eye_in_hand", map={"qpos": "states"}, num_steps=2)
    assert wrist.mapping["pixels"] == "obs/robot0_eye_in_hand_image"
    assert wrist[0]["qpos"].shape == (2, 9)
    with pytest.raises(swm.DataError, match="no camera is called `left`"):
        swm.data.load_dataset(FIELD / "robomimic_can.hdf5", camera="left")
    with pytest.raises(swm.DataError, match="no part `test`"):
        swm.data.load_dataset(FIELD / "dinowm_pusht_noise", split="test")


def test_every_call_that_opens_a_dataset_takes_its_options(tmp_path: Path) -> None:
    can, copy = FIELD / "robomimic_can.hdf5", tmp_path / "wrist.h5"
    swm.data.convert(can, copy, opening={"camera": "robot0_eye_in_hand"}, progress=False)
    written = swm.data.load_dataset(copy)
    assert written.metadata["source"]["columns"]["pixels"] == "obs/robot0_eye_in_hand_image"
    assert written.metadata["source"]["options"] == {"camera": "robot0_eye_in_hand"}
    both = tmp_path / "both.h5"
    again = shutil.copy(can, tmp_path / "again.hdf5")
    swm.data.merge([can, again], both, opening={"split": "valid"}, progress=False)
    assert swm.data.load_dataset(both).lengths.tolist() == [6, 6]
    noise = FIELD / "dinowm_pusht_noise"
    with pytest.raises(swm.DataError, match="no part `test`"):
        swm.replay(noise, opening={"split": "test"}, progress=False)
    made = swm.make_manifest(tmp_path / "task.toml", "swm/PushT-v1", 2, dataset=noise, goal_offset=3, opening={"split": "train"})
    assert len(made["pairs"]) == 2
    with pytest.raises(swm.SwmError, match="no part `test`"):
        swm.make_manifest(tmp_path / "other.toml", "swm/PushT-v1", 2, dataset=noise, opening={"split": "test"})
    with pytest.raises(swm.SwmError, match="camera: is about a dataset, and none is named"):
        swm.make_manifest(tmp_path / "other.toml", "swm/PushT-v1", 2, opening={"camera": "top"})


def test_images_are_resized_by_area(tmp_path: Path) -> None:
    source, copy = FIELD / "robomimic_can.hdf5", tmp_path / "small.h5"
    stored = np.asarray(swm.data.load_dataset(source).load_episode(0)["pixels"])
    swm.data.convert(source, copy, image_size=(stored.shape[-2] // 2, stored.shape[-1] // 2), progress=False)
    small = np.asarray(swm.data.load_dataset(copy).load_episode(0)["pixels"]).astype(int)
    whole = stored.astype(int)
    corners = whole[..., ::2, ::2] + whole[..., 1::2, ::2] + whole[..., ::2, 1::2] + whole[..., 1::2, 1::2]
    assert np.array_equal(small, (corners + 2) // 4)
    with pytest.raises(swm.SwmError, match="fit: .* of another shape than 10 x 20; use stretch, crop or pad"):
        swm.data.convert(source, tmp_path / "wide.h5", image_size=(10, 20), progress=False)
    padded = swm.data.load_dataset(source).resized((10, 20), "pad")
    opened = swm.data.load_dataset(source, image_size=(10, 20), fit="pad", num_steps=2)
    assert np.array_equal(np.asarray(opened[0]["pixels"])[:1], np.asarray(padded[0]["pixels"]))
    with pytest.raises(swm.DataError, match="no image is resized"):
        swm.data.load_dataset(source, fit="pad")
    assert tuple(padded[0]["pixels"].shape)[-2:] == (10, 20)
    with pytest.raises(swm.DataError, match="holds no images"):
        swm.data.load_dataset(FIELD / "halfcheetah-medium-v2.hdf5").resized((8, 8), "crop")
    with pytest.raises(ValueError, match="no image is resized"):
        swm.data.convert(source, tmp_path / "none.h5", fit="crop", progress=False)


def test_evaluations_refuse_what_does_not_fit() -> None:
    world = swm.World("swm/PushT-v1", num_envs=1, add_pixels=False)
    world.set_policy(swm.policy.RandomPolicy(0))
    human = FIELD / "pusht_cchi_v7_replay.zarr"
    with pytest.raises(swm.SwmError, match="its `state` has 5 values a row, that of swm/PushT-v1 has 7"):
        swm.evaluate_from_dataset(world, human, episodes=1, goal_offset=2)
    with pytest.raises(swm.SwmError, match="100 % of its actions are outside of the space of swm/PushT-v1"):
        swm.evaluate_from_dataset(world, human, episodes=1, goal_offset=2, opening={"map": {"all": "state"}})
