"""Stable-Baselines3 learns on environments of this package: PPO, SAC and HER, each much better than random actions.

Skipped where it is not installed: it needs torch, which is larger than all other packages of the tests together.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import stable_worldmodel_rs  # noqa: F401  registers the environments

sb3 = pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed; it needs torch")
torch = pytest.importorskip("torch")


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Small networks are faster on one thread, and repeat."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
    torch.set_num_threads(threads)


def mean_return(env: Any, act: Any, episodes: int = 10) -> float:
    """The mean return of a function from observations to actions, in episodes of one seed."""
    total = 0.0
    for episode in range(episodes):
        observation, _ = env.reset(seed=1000) if episode == 0 else env.reset()
        over = False
        while not over:
            observation, reward, terminated, truncated, _ = env.step(act(observation))
            total += float(reward)
            over = terminated or truncated
    return total / episodes


def returns(model: Any, env: Any) -> tuple[float, float]:
    """Of random actions, and of the model."""
    env.action_space.seed(0)
    random = mean_return(env, lambda _: env.action_space.sample())
    return random, mean_return(env, lambda observation: model.predict(observation, deterministic=True)[0])


@pytest.mark.parametrize("name", ["swm/PushT-v1", "swm/CartPoleControl-v1", "swm/TwoRoom-v1", "swm/PointMaze-v0"])
def test_its_checker_passes(name: str) -> None:
    from stable_baselines3.common.env_checker import check_env

    check_env(gym.make(name, max_episode_steps=20))


def test_its_checker_passes_on_fetch(mujoco: None) -> None:
    from stable_baselines3.common.env_checker import check_env

    for name in ("swm/FetchReach-v3", "swm/FetchReachDict-v3"):
        check_env(gym.make(name))


def test_ppo_learns_to_balance() -> None:
    env = gym.make("swm/CartPoleControl-v1", max_episode_steps=200)
    model = sb3.PPO(
        "MultiInputPolicy", env, n_steps=256, n_epochs=8, learning_rate=1e-3, seed=0, device="cpu", policy_kwargs={"net_arch": [32]}
    )
    model.learn(8192)
    random, learned = returns(model, env)
    assert random < 40 and learned > 120, (random, learned)


def test_sac_learns_to_swing_up() -> None:
    env = gym.make("swm/PendulumControl-v1", max_episode_steps=200)
    model = sb3.SAC(
        "MultiInputPolicy", env, learning_starts=200, train_freq=4, gradient_steps=4, batch_size=64, learning_rate=3e-3, seed=0, device="cpu",
        policy_kwargs={"net_arch": [32, 32]},
    )  # fmt: skip
    model.learn(3000)
    random, learned = returns(model, env)
    assert random < -900 and learned > random + 400, (random, learned)


def test_her_learns_to_reach_goals() -> None:
    goals = {"observation": ["proprio"], "achieved_goal": "state", "desired_goal": "goal_state", "elements": [0, 1], "below": 1.0}
    env = gym.make("swm/PointMaze-v0", max_episode_steps=50, goals=goals)
    model = sb3.SAC(
        "MultiInputPolicy", env, replay_buffer_class=sb3.HerReplayBuffer, learning_starts=200, train_freq=2, batch_size=128, gamma=0.95,
        learning_rate=3e-3, seed=0, device="cpu", policy_kwargs={"net_arch": [64, 64]},
    )  # fmt: skip
    model.learn(3000)
    random, learned = returns(model, env)
    assert random < -40 and learned > random + 10, (random, learned)
