"""`gymnasium.make`: the interface, its checker, and that episodes are those of a World."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import envs
from stable_worldmodel_rs.world.env_pool import EnvPool

World = Callable[..., Any]
TWO_D = sorted(name for name in envs.gym_ids() if "DMControl" not in name and "OGB" not in name)
MUJOCO = sorted(name for name in envs.WORLDS if "DMControl" in name)
OGBENCH = sorted(name for name in envs.WORLDS if "OGB" in name)


def check(name: str, **options: Any) -> None:
    with warnings.catch_warnings():
        # States of simulators have no bounds, and older versions are offered for comparison.
        warnings.filterwarnings("ignore", message=".*observation space (minimum|maximum) value.*")
        warnings.filterwarnings("ignore", message=".*is out of date.*")
        warnings.filterwarnings("ignore", message=".*action space.*")
        warnings.simplefilter("error", DeprecationWarning)
        warnings.filterwarnings("ignore", message=".*out of date.*", category=DeprecationWarning)
        check_env(gym.make(name, **options).unwrapped)


@pytest.mark.parametrize("name", TWO_D)
def test_the_checker_passes(name: str) -> None:
    check(name, image_shape=(32, 32), render_mode="rgb_array")


@pytest.mark.parametrize("name", MUJOCO)
def test_the_checker_passes_on_mujoco(name: str, mujoco: None) -> None:
    check(name)


@pytest.mark.parametrize("name", OGBENCH)
def test_the_checker_passes_on_ogbench(name: str, ogbench: None) -> None:
    check(name)


def test_ids_are_those_of_the_core() -> None:
    for version in ("v1", "v2"):
        for namespace in ("swm", "swm_rs"):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                made = gym.make(f"{namespace}/TwoRoom-{version}")
            assert made.unwrapped.pool.core.id == f"swm/TwoRoom-{version}"  # type: ignore[attr-defined]
    assert {"swm/PushT-v1", "swm/CheetahDMControl-v0"} <= envs.WORLDS
    assert envs.DISCRETE_WORLDS == {"swm/PushT-Discrete-v1"}
    with pytest.raises(gym.error.NameNotFound):
        gym.make("swm/Fetch-v9")


def test_an_environment_gives_the_episodes_of_a_world(world: World) -> None:
    env = gym.make("swm/PushT-v1", image_shape=(32, 32))
    one = world(num_envs=1)
    observation, info = env.reset(seed=7)
    one.reset(seed=7)
    actions = np.random.default_rng(0).uniform(-1, 1, (10, 2)).astype(np.float32)
    for action in [None, *actions]:
        if action is not None:
            observation, reward, terminated, truncated, info = env.step(action)
            one.envs.step(action[None])
            assert reward == one.infos["reward"][0, 0]
            assert not terminated and not truncated
        for name, value in {**observation, **info}.items():
            if name != "env_name":
                np.testing.assert_array_equal(value, one.infos[name][0, 0], err_msg=name)
    assert info["env_name"] == "swm/PushT-v1"


def test_later_resets_begin_the_next_episodes_of_the_run() -> None:
    env = gym.make("swm/PushT-v1")
    first = env.reset(seed=3)[1]["seed"]
    second = env.reset()[1]["seed"]
    assert first != second
    assert env.reset(seed=3)[1]["seed"] == env.reset(seed=np.int64(3))[1]["seed"] == first  # type: ignore[arg-type]
    assert env.reset()[1]["seed"] == second


def test_observations_are_copies_unless_asked_otherwise() -> None:
    for copy in (True, False):
        env = gym.make("swm/PushT-v1", copy=copy, disable_env_checker=True)
        observation, _ = env.reset(seed=0)
        before = observation["state"].copy()
        env.step(np.array([1, 1], np.float32))
        assert np.array_equal(observation["state"], before) == copy


def test_variations_and_settings() -> None:
    env = gym.make("swm/PushT-v1", render="fast", image_shape=(48, 64), render_mode="rgb_array")
    observation, info = env.reset(seed=0, options={"variation_values": {"agent.color": [255, 0, 0]}})
    assert observation["pixels"].shape == (48, 64, 3) and info["goal"].dtype == np.uint8
    image = env.render()
    assert isinstance(image, np.ndarray)
    np.testing.assert_array_equal(image, observation["pixels"])
    space = env.unwrapped.variation_space  # type: ignore[attr-defined]
    np.testing.assert_array_equal(space["agent"]["color"].value, [255, 0, 0])
    images = []
    for shape in (6, "small T", "small-t"):
        images.append(env.reset(seed=0, options={"variation_values": {"block.shape": shape}})[0]["pixels"].copy())
    assert all(np.array_equal(images[0], image) for image in images), "a choice by number and by name"
    for wrong, words in (("U", r"one of L, T, Z,"), ("sqare", r"did you mean `square`\?")):
        with pytest.raises(ValueError, match=rf"block\.shape.*{wrong}.*{words}"):
            env.reset(options={"variation_values": {"block.shape": wrong}})
    with pytest.raises(swm.EnvError, match="nonsense"):
        gym.make("swm/PushT-v1", nonsense=1)
    with pytest.raises(swm.EnvError, match="did you mean image_shape=?"):
        gym.make("swm/PushT-v1", image_size=(64, 64))
    with pytest.raises(swm.EnvError, match="did you mean num_envs=?"):
        swm.World("swm/PushT-v1", num_env=2, add_pixels=False)
    with pytest.raises(swm.EnvError, match="did you mean max_episode_steps=?"):
        swm.World("swm/PushT-v1", max_steps=50, add_pixels=False)
    with pytest.raises(ValueError, match="agent.colr"):
        env.reset(options={"variation_values": {"agent.colr": [1, 2, 3]}})


def test_without_images_there_are_none() -> None:
    env = gym.make("swm/PushT-v1")
    observation, info = env.reset(seed=0)
    assert "pixels" not in observation and "goal" not in info and env.render() is None
    shown = gym.make("swm/PushT-v1", render_mode="rgb_array")
    observation, info = shown.reset(seed=0)
    assert "pixels" not in observation and "goal" not in info
    image = shown.render()
    assert isinstance(image, np.ndarray) and image.shape == (224, 224, 3)


def test_time_limits_and_wrappers_of_gymnasium_work() -> None:
    env = gym.wrappers.RecordEpisodeStatistics(gym.make("swm/PushT-v1", max_episode_steps=3))
    env.reset(seed=0)
    for step in range(3):
        _, _, _, truncated, info = env.step(env.action_space.sample())
        assert truncated == (step == 2)
    assert info["episode"]["l"] == 3


def test_spec_makes_the_same_environment_again() -> None:
    env = gym.make("swm/PushT-v1", image_shape=(24, 24))
    assert env.spec is not None
    again = gym.make(env.spec)
    np.testing.assert_array_equal(again.reset(seed=1)[0]["pixels"], env.reset(seed=1)[0]["pixels"])


def test_a_world_runs_foreign_environments(world: World) -> None:
    made = world("CartPole-v1", add_pixels=False, image_shape=None)
    assert isinstance(made.envs, EnvPool)
    made.reset(seed=0)
    assert made.infos and all(len(column) == 2 for column in made.infos.values())


def test_info_describes_environments() -> None:
    info = envs.info("swm/PushT-v1")
    assert "render" in [name for name, _, _ in info["settings"]] and "expert" in info["policies"]
    assert len(envs.info()) >= 22
    with pytest.raises(gym.error.NameNotFound, match="swm/Nowhere-v0"):
        envs.info("swm/Nowhere-v0")
