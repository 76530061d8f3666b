"""Published datasets of other programs, opened where they are."""

from __future__ import annotations

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
