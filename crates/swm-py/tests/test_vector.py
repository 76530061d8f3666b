"""`gymnasium.make_vec`: three ways of autoreset, against single environments and gymnasium's own vectors."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import stable_worldmodel_rs as swm

ID = "swm/PushT-v1"


def actions(steps: int, num_envs: int = 3) -> Any:
    return np.random.default_rng(1).uniform(-1, 1, (steps, num_envs, 2)).astype(np.float32)


def make(mode: str = "NextStep", **options: Any) -> Any:
    options.setdefault("max_episode_steps", 4)
    return gym.make_vec(ID, num_envs=3, autoreset_mode=mode, **options)


def test_spaces_shapes_and_types() -> None:
    envs = make(image_shape=(16, 16))
    observations, infos = envs.reset(seed=0)
    assert observations in envs.observation_space
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert envs.single_action_space.shape == (2,) and envs.action_space.shape == (3, 2)
    observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
    assert observations in envs.observation_space
    assert rewards.shape == (3,) and rewards.dtype == np.float64
    assert terminated.dtype == truncated.dtype == np.bool_
    assert infos["goal"].shape == (3, 16, 16, 3) and infos["_goal"].all()
    assert list(infos["env_name"]) == [ID] * 3
    envs.close()


def test_next_step_resets_where_gymnasium_does() -> None:
    ours = make()
    theirs = gym.make_vec(ID, num_envs=3, vectorization_mode="sync", max_episode_steps=4)
    ours.reset(seed=0)
    theirs.reset(seed=0)
    for step in actions(12):
        _, mine, *ends, infos = ours.step(step)
        _, other, *expected, others = theirs.step(step)
        np.testing.assert_array_equal(ends[1], expected[1])
        np.testing.assert_array_equal(infos["step_idx"], others["step_idx"])
        np.testing.assert_array_equal(mine == 0.0, other == 0.0)


def test_environment_0_is_the_single_environment() -> None:
    ours = make()
    single = gym.make(ID)
    ours.reset(seed=5)
    single.reset(seed=5)
    for step in actions(4):
        observations, rewards, *_ = ours.step(step)
        observation, reward, *_ = single.step(step[0])
        assert rewards[0] == reward
        np.testing.assert_array_equal(observations["state"][0], observation["state"])


def test_same_step_keeps_how_episodes_ended() -> None:
    ours, plain = make("SameStep"), make("Disabled")
    ours.reset(seed=2)
    plain.reset(seed=2)
    for number, step in enumerate(actions(4)):
        observations, rewards, _, truncated, infos = ours.step(step)
        last, expected, _, ends, last_infos = plain.step(step)
        np.testing.assert_array_equal(rewards, expected)
        np.testing.assert_array_equal(truncated, ends)
        assert ("final_obs" in infos) == (number == 3)
    assert truncated.all() and infos["_final_obs"].all()
    np.testing.assert_array_equal(infos["step_idx"], 0)
    for row in range(3):
        np.testing.assert_array_equal(infos["final_obs"][row]["state"], last["state"][row])
    np.testing.assert_array_equal(infos["final_info"]["step_idx"], last_infos["step_idx"])
    observations, *_, truncated, infos = ours.step(actions(1)[0])
    assert not truncated.any()
    np.testing.assert_array_equal(infos["step_idx"], 1)


def test_disabled_resets_what_the_mask_says() -> None:
    envs = make("Disabled")
    envs.reset(seed=0)
    for step in actions(2):
        envs.step(step)
    before = envs.reset(options={"reset_mask": np.array([False, True, False])})[1]
    np.testing.assert_array_equal(before["step_idx"], [2, 0, 2])
    for step in actions(2):
        _, _, _, truncated, infos = envs.step(step)
    np.testing.assert_array_equal(truncated, [True, False, True])
    with pytest.raises(swm.SwmError, match="reset_mask"):
        envs.step(actions(1)[0])
    for wrong in (np.array([True]), np.array([1, 0, 1]), np.zeros(3, np.bool_)):
        with pytest.raises(swm.SwmError, match="reset_mask"):
            envs.reset(options={"reset_mask": wrong})


def test_threads_and_copies_change_nothing() -> None:
    one, many, views = make(threads=1), make(threads=3), make(copy=False)
    for envs in (one, many, views):
        envs.reset(seed=9)
    for step in actions(9):
        results = [envs.step(step) for envs in (one, many, views)]
        for name in results[0][0]:
            np.testing.assert_array_equal(results[0][0][name], results[1][0][name])
            np.testing.assert_array_equal(results[0][0][name], results[2][0][name])


def test_options_and_seeds_for_each_environment() -> None:
    envs = make()
    options = [{"variation_values": {"agent.color": [row, 0, 0]}} for row in range(3)]
    _, infos = envs.reset(seed=[11, 12, 13], options=options)
    np.testing.assert_array_equal(infos["seed"], [11, 12, 13])
    np.testing.assert_array_equal(infos["variation.agent.color"][:, 0], [0, 1, 2])
    with pytest.raises(swm.SwmError, match="2 seeds for 3"):
        envs.reset(seed=[1, 2])


def test_rendering() -> None:
    envs = make(render_mode="rgb_array", image_shape=(20, 24))
    observations, _ = envs.reset(seed=0)
    images = envs.render()
    assert len(images) == 3
    np.testing.assert_array_equal(np.stack(images), observations["pixels"])
    with pytest.raises(swm.SwmError, match="rgb_array"):
        make(render_mode="ansi")
