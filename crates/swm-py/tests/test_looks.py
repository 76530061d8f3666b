"""Looks of recordings without images: sampled per clip and epoch, and pairs in a canonical look."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import stable_worldmodel_rs as swm
from stable_worldmodel_rs.data import load_dataset

SIZE = (32, 32)


@pytest.fixture(scope="module")
def states(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Episodes without images, with checkpoints."""
    path = tmp_path_factory.mktemp("looks") / "states.h5"
    world = swm.World("swm/PushT-v1", 2, image_shape=SIZE, max_episode_steps=20, threads=1)
    world.set_policy("random")
    world.collect(path, episodes=3, seed=4, replayable=4, progress=False)
    return path


def images(item: dict[str, object], name: str = "pixels") -> NDArray[np.uint8]:
    return np.asarray(item[name])


def test_clips_are_rendered_in_sampled_looks(states: Path) -> None:
    def opened(**looks: object) -> swm.data.NativeDataset:
        return load_dataset(states, render=SIZE, num_steps=3, frameskip=2, keys_to_load=["pixels", "state", "action"], **looks)

    plain, varied = opened(), opened(vary=["background.color", "goal"], vary_seed=2)
    assert np.array_equal(np.asarray(plain[5]["state"]), np.asarray(varied[5]["state"]))
    first = images(varied[5])
    assert not np.array_equal(first, images(plain[5]))
    assert np.array_equal(first, images(varied[5])) and np.array_equal(first, images(varied.__getitems__([2, 5])[1]))
    # The table has one color in all images of a clip, another one in the next clip and epoch.
    corner = first[:, :, 8, 8]
    assert (corner == corner[0]).all()
    varied.set_epoch(1)
    assert not np.array_equal(first, images(varied[5]))
    varied.set_epoch(0)
    assert np.array_equal(first, images(varied[5]))
    assert not np.array_equal(first, images(opened(vary=["background.color", "goal"], vary_seed=3)[5]))
    assert np.array_equal(images(plain[5]), images(opened(vary=["visual"], vary_usual=1.0)[5]))


def test_pairs_show_one_state_in_two_looks(states: Path) -> None:
    canonical = {"background.color": "black", "agent.color": [255, 0, 0]}
    pairs = load_dataset(states, render=SIZE, vary=["*.color"], canonical=canonical)
    dark = load_dataset(states, render=SIZE, look=canonical)
    assert np.array_equal(images(pairs[7], "canonical"), images(dark[7]))
    assert not np.array_equal(images(pairs[7]), images(dark[7]))
    recorded = load_dataset(states, render=SIZE, vary=["*.color"], canonical={})
    assert np.array_equal(images(recorded[7], "canonical"), images(load_dataset(states, render=SIZE)[7]))
    assert list(np.asarray(dark[7]["variation.agent.color"]).reshape(-1)) == [255, 0, 0]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"vary": ["agent.scale"]}, "agent.scale.*does not change images alone"),
        ({"vary": ["agent.colr"]}, "did you mean `agent.color`"),
        ({"look": {"agent.scale": 60.0}}, "agent.scale.*does not change images alone"),
        ({"look": ["agent.scale"]}, "look is list; give a dict of factors"),
        ({"canonical": "as recorded"}, "canonical is str; give a dict of factors"),
        ({"canonical": {"block.scale": 30.0}}, "block.scale.*does not change images alone"),
        ({"look": {"background.color": "blakc"}}, "blakc"),
        ({"vary": ["visual"], "vary_share": 2.0}, "vary_share=2.0: give a number from 0 to 1"),
        ({"vary": ["visual"], "vary_seed": -1}, "vary_seed=-1: give 0 or more"),
        ({"look": {"background.color": [float("nan"), 0.0, 0.0]}}, r"look\['background.color'\].*a number is NaN"),
        ({"vary": ["visual"], "keys_to_cache": ["pixels"]}, "keys_to_cache"),
        ({"vary": ["visual"], "render": None}, r"render=\(64, 64\)"),
    ],
)
def test_what_is_no_look_is_refused(states: Path, arguments: dict[str, object], reason: str) -> None:
    with pytest.raises((TypeError, ValueError, swm.SwmError), match=reason):
        load_dataset(states, **({"render": SIZE} | arguments))


def test_a_list_of_factors_is_no_text(states: Path) -> None:
    with pytest.raises(TypeError, match="vary='visual'"):
        load_dataset(states, render=SIZE, vary="visual")
