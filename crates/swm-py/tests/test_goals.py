"""Observations of Gymnasium as libraries of reinforcement learning take them: shapes, goals, copies."""

from __future__ import annotations

import copy
import pickle
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import envs

ACTION = np.array([0.7, -0.3], np.float32)
REACH = "swm/FetchReachDict-v3"
PUSHT_GOALS = {"observation": ["proprio", "n_contacts"], "achieved_goal": "state", "desired_goal": "goal_state", "elements": [2, 3], "below": 20.0}
COPIES: dict[str, Callable[[Any], Any]] = {"deepcopy": copy.deepcopy, "pickle": lambda one: pickle.loads(pickle.dumps(one))}


def make(name: str, **options: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return gym.make(name, disable_env_checker=True, **options)


@pytest.mark.parametrize("name", sorted(name for name in envs.gym_ids() if not any(part in name for part in ("DMControl", "OGB", "Fetch"))))
def test_no_observation_is_a_scalar(name: str) -> None:
    env = make(name)
    observation, _ = env.reset(seed=0)
    assert all(space.shape for space in env.observation_space.spaces.values())
    assert all(observation[key].shape == space.shape and observation[key] in space for key, space in env.observation_space.items())


def test_scalars_of_fetch_and_of_vectors_have_one_element(mujoco: None) -> None:
    env = make("swm/FetchReach-v3")
    assert env.reset(seed=0)[0]["time"].shape == env.observation_space["time"].shape == (1,)
    vector = gym.make_vec("swm/PushT-v1", num_envs=3)
    observations, _ = vector.reset(seed=0)
    assert observations["n_contacts"].shape == (3, 1) and observations in vector.observation_space
    assert swm.World("swm/PushT-v1", 3, add_pixels=False).envs.single_observation_space["n_contacts"].shape == (1,)


def test_fetch_has_goals_and_a_reward_of_them(mujoco: None) -> None:
    env = make(REACH).unwrapped
    observation, _ = env.reset(seed=0)
    assert {name: value.shape for name, value in observation.items()} == {
        "observation": (10,),
        "achieved_goal": (3,),
        "desired_goal": (3,),
    }
    core = env.pool
    for step in range(20):
        observation, reward, terminated, truncated, info = env.step(np.array([1, 0.2, -0.1, 0]) if step < 10 else env.action_space.sample())
        assert observation in env.observation_space
        achieved, desired = observation["achieved_goal"], observation["desired_goal"]
        assert reward == core.raw("reward")[0, 0] == env.compute_reward(achieved, desired, info)
        assert info["is_success"] == (reward == 0) and not terminated
        np.testing.assert_array_equal(desired, core.raw("desired_goal")[0, 0])
    batch = np.stack([achieved, achieved + [0.04, 0, 0], achieved + [0, 0.06, 0]])
    np.testing.assert_array_equal(env.compute_reward(batch, np.stack([achieved] * 3), [{}] * 3), [0, 0, -1])
    assert isinstance(env.compute_reward(achieved, desired, {}), float)
    dense = make("swm/FetchReachDense-v3", goals=True).unwrapped
    observation, _ = dense.reset(seed=0)
    observation, reward, *_ = dense.step(dense.action_space.sample())
    assert reward == pytest.approx(dense.pool.raw("reward")[0, 0]) and reward < -0.01
    # The flat ids stay as they are: no key is a goal.
    assert "desired_goal" not in make("swm/FetchReach-v3").observation_space.spaces
    assert "qpos" in make(REACH, goals=False).observation_space.spaces


def test_goals_of_other_environments_are_chosen_by_columns() -> None:
    env = make("swm/PushT-v1", goals=PUSHT_GOALS, image_shape=(16, 16))
    observation, info = env.reset(seed=0)
    assert set(observation) == {"observation", "achieved_goal", "desired_goal", "pixels"}
    np.testing.assert_array_equal(observation["observation"], [*info["proprio"], info["n_contacts"]])
    np.testing.assert_array_equal(observation["desired_goal"], info["goal_state"][2:4])
    observation, reward, *_, info = env.step(ACTION)
    np.testing.assert_array_equal(observation["achieved_goal"], info["state"][2:4])
    assert reward == -1 and not info["is_success"]
    vector = gym.make_vec("swm/PushT-v1", num_envs=2, goals=PUSHT_GOALS)
    observations, _ = vector.reset(seed=0)
    np.testing.assert_array_equal(observations["desired_goal"][0], observation["desired_goal"])
    _, rewards, *_, infos = vector.step(np.stack([ACTION, ACTION]))
    assert rewards.tolist() == [-1, -1] and infos["is_success"].tolist() == [False, False]
    assert vector.single_observation_space["observation"].shape == (5,)


@pytest.mark.parametrize(
    ("goals", "words"),
    [
        (True, "no goals of its own; name them"),
        ({}, "`observation`, `achieved_goal`, `desired_goal`, `below` is missing"),
        ({**PUSHT_GOALS, "achieved": "state"}, "no `achieved`.*did you mean `achieved_goal`"),
        ({**PUSHT_GOALS, "desired_goal": "goal_stat"}, "no column `goal_stat`"),
        ({**PUSHT_GOALS, "elements": [2, 7]}, r"elements \[2, 7\] are not all in 0..6"),
        ({**PUSHT_GOALS, "elements": [], "desired_goal": "goal_proprio"}, "choose elements"),
    ],
)
def test_unusable_goals_are_refused(goals: Any, words: str) -> None:
    with pytest.raises(swm.SwmError, match=words):
        make("swm/PushT-v1", goals=goals)
    assert not hasattr(make("swm/PushT-v1").unwrapped, "compute_reward"), "by it, libraries know environments with goals"


def rows(observation: dict[str, Any]) -> list[bytes]:
    return [np.asarray(value).tobytes() for _, value in sorted(observation.items())]


@pytest.mark.parametrize("how", COPIES)
def test_copies_of_environments_go_on_alike(how: str) -> None:
    env = make("swm/PushT-v1", image_shape=(24, 24), max_episode_steps=9)
    for taken in range(3):
        env.reset(seed=3, options={"variation": ["all"]}) if taken == 0 else env.step(ACTION)
    other = COPIES[how](env)
    assert rows(other.unwrapped._observation()) == rows(env.unwrapped._observation())
    for step in range(7):
        (first, *ends), (second, *others) = env.step(ACTION), other.step(ACTION)
        assert rows(first) == rows(second) and ends[:3] == others[:3], step
    assert ends[2], "both have counted the steps before the copy"
    first, second = env.reset(), other.reset()
    assert rows(first[0]) == rows(second[0]) and first[1]["seed"] == second[1]["seed"]
    again = COPIES[how](make("swm/PushT-v1"))
    assert again.reset(seed=1)[0]["state"].shape == (7,)


@pytest.mark.parametrize("how", COPIES)
def test_copies_of_vectors_and_worlds_go_on_alike(how: str) -> None:
    vector = gym.make_vec("swm/PushT-v1", num_envs=3, max_episode_steps=5, autoreset_mode="SameStep")
    vector.reset(seed=2)
    actions = np.stack([ACTION] * 3)
    vector.step(actions)
    twin = COPIES[how](vector)
    for _ in range(8):
        first, second = vector.step(actions), twin.step(actions)
        assert rows(first[0]) == rows(second[0]) and first[1].tolist() == second[1].tolist() and first[3].tolist() == second[3].tolist()
    options = {"variation": ["agent.color"]}
    world = swm.World("swm/PushT-v1", 3, image_shape=(16, 16), max_episode_steps=6, threads=1, distractors=["noise"])
    world.set_policy("random")
    world.reset(seed=4, options=options)
    world.step()
    other = COPIES[how](world)
    for name, values in world.infos.items():
        np.testing.assert_array_equal(np.asarray(other.infos[name]), np.asarray(values), err_msg=name)
    np.testing.assert_array_equal(other.rewards, world.rewards)
    assert "variation.agent.color" in other.infos and "variation.block.color" not in other.infos
    for _ in range(5):
        world.step()
        other.step()
        for name in ("state", "pixels", "action", "reward", "terminated", "truncated"):
            np.testing.assert_array_equal(other.infos[name], world.infos[name], err_msg=name)
    assert world.envs.core is not other.envs.core
    world.reset()
    assert not np.array_equal(other.infos["step_idx"], world.infos["step_idx"]), "they are two"
    assert other.evaluate(episodes=3, seed=1)["success_rate"] == 0
    world.set_success({"hold": 1, "all": [{"column": "state", "goal": "goal_state", "elements": [0], "measure": "distance", "below": 1e4}]})
    assert COPIES[how](world).evaluate(episodes=3, seed=1)["success_rate"] == 100, "the rule is copied"


def test_copies_of_worlds_have_policies_of_their_own() -> None:
    class Counts:
        calls = 0

        def get_action(self, infos: dict[str, Any]) -> Any:
            self.calls += 1
            return np.stack([ACTION] * 2)

    world = swm.World("swm/PushT-v1", 2, add_pixels=False)
    world.set_policy(Counts())
    world.reset(seed=0)
    world.step()
    other = copy.deepcopy(world)
    other.step()
    assert (world.policy.calls, other.policy.calls) == (1, 2)
    for planner in ("cem:samples=4,iterations=1,elites=2,report=plan", "random"):
        world.set_policy(planner)
        world.reset(seed=0)
        world.step()
        twin = pickle.loads(pickle.dumps(world))
        assert set(twin.infos) == set(world.infos)
        np.testing.assert_array_equal(twin.infos["state"], world.infos["state"])
        twin.step()


def test_a_step_of_an_environment_that_is_over_is_refused() -> None:
    env = swm.envs.Env("swm/CartPoleControl-v1")
    with pytest.raises(swm.EnvError, match="no episode has begun"):
        env.step(0)
    env.reset(seed=0)
    while not env.step(0)[2]:
        pass
    with pytest.raises(swm.EnvError, match="over; call `reset`"):
        env.step(0)
    env.reset()
    env.step(0)
