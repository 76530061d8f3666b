"""Stable-Baselines3 learns on environments of this package: PPO, SAC and HER, each much better than random actions.

Skipped where it is not installed: it needs torch, which is larger than all other packages of the tests together.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
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


@pytest.mark.parametrize("name", ["swm/PushT-v1", "swm/CartPoleControl-v1", "swm/TwoRoom-v2", "swm/PointMaze-v0"])
def test_its_checker_passes(name: str) -> None:
    from stable_baselines3.common.env_checker import check_env

    check_env(gym.make(name, max_episode_steps=20))


def test_its_checker_passes_on_fetch(mujoco: None) -> None:
    from stable_baselines3.common.env_checker import check_env

    for name in ("swm/FetchReach-v3", "swm/FetchReachDict-v3"):
        # Its checker does not look for `compute_reward` below the wrappers of gymnasium.
        check_env(gym.make(name).unwrapped)


def test_ppo_learns_to_balance() -> None:
    env = gym.make("swm/CartPoleControl-v1", max_episode_steps=200)
    model = sb3.PPO(
        "MultiInputPolicy", env, n_steps=256, n_epochs=8, learning_rate=1e-3, seed=0, device="cpu", policy_kwargs={"net_arch": [32]}
    )
    model.learn(8192)
    random, learned = returns(model, env)
    assert random < 40 and learned > 120, (random, learned)


class Arena(gym.Wrapper[Any, Any, Any, Any]):
    """PointMaze without inner walls: a disc is to reach a goal anywhere."""

    GOALS = {"observation": ["proprio"], "achieved_goal": "state", "desired_goal": "goal_state", "elements": [0, 1], "below": 2.5}

    def __init__(self, dense: bool) -> None:
        super().__init__(gym.make("swm/PointMaze-v0", max_episode_steps=50, goals={**self.GOALS, "dense": dense}))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        return self.env.reset(seed=seed, options={"variation_values": {"maze.layout": 3}})


SETTINGS: dict[str, Any] = {
    "seed": 0,
    "device": "cpu",
    "learning_starts": 150,
    "batch_size": 64,
    "learning_rate": 2e-3,
    "tau": 0.02,
    "policy_kwargs": {"net_arch": [64, 64]},
}


def test_sac_learns_to_approach_goals() -> None:
    model = sb3.SAC("MultiInputPolicy", Arena(dense=True), gamma=0.95, ent_coef=0.1, **SETTINGS)
    model.learn(1500)
    random, learned = returns(model, Arena(dense=True))
    assert learned > random + 120, (random, learned)


def test_her_learns_to_reach_goals() -> None:
    model = sb3.SAC("MultiInputPolicy", Arena(dense=False), gamma=0.92, ent_coef=0.05, replay_buffer_class=sb3.HerReplayBuffer, **SETTINGS)
    model.learn(1500)
    random, learned = returns(model, Arena(dense=False))
    assert learned > random + 12, (random, learned)
