"""Policies: native ones by name, Python ones in native runs, and that both see and do the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stable_worldmodel_rs as swm


def make(num_envs: int = 3, **kwargs: object) -> swm.World:
    return swm.World("swm/PushT-v1", num_envs, image_shape=(32, 32), threads=1, **kwargs)


class Spring:
    """Pulls the agent to the middle, and notes what it was given."""

    def __init__(self) -> None:
        self.steps: list[np.ndarray] = []
        self.actions: list[np.ndarray] = []
        self.begun: list[np.ndarray] = []
        self.envs: object = None

    def set_env(self, envs: object) -> None:
        self.envs = envs

    def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
        flush = infos.pop("_needs_flush", None)
        if flush is not None:
            self.begun.append(flush)
        self.steps.append(infos["step_idx"][:, 0].copy())
        self.actions.append(infos["action"][:, 0].copy())
        actions = (256 - infos["state"][:, 0, :2]) / 256
        actions[infos["terminated"][:, 0]] = np.nan
        return actions


def test_python_policies_give_the_same_episodes_whatever_the_number_of_environments() -> None:
    results = []
    for num_envs in (1, 2, 5):
        world = make(num_envs, max_episode_steps=20)
        world.set_policy(Spring())
        results.append(world.evaluate(episodes=5, seed=3))
    for result in results[1:]:
        np.testing.assert_array_equal(result["episode_returns"], results[0]["episode_returns"])
        np.testing.assert_array_equal(result["seeds"], results[0]["seeds"])


def test_a_python_policy_is_a_native_one() -> None:
    class Constant:
        def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
            return np.full((2, 2), [0.5, -0.25], np.float32)

    world = make(2)
    world.set_policy(Constant())
    ours = world.evaluate(episodes=5, seed=1)
    world.set_policy("constant:0.5,-0.25")
    native = world.evaluate(episodes=5, seed=1)
    np.testing.assert_array_equal(ours["episode_returns"], native["episode_returns"])
    np.testing.assert_array_equal(ours["episode_lengths"], native["episode_lengths"])


def test_a_native_run_is_a_run_by_hand() -> None:
    world = make(2, max_episode_steps=15)
    world.set_policy(Spring())
    native = world.evaluate(episodes=2, seed=9)["episode_returns"]
    world.reset(seed=9)
    returns = np.zeros(2)
    for _ in range(15):
        world.step()
        returns += world.infos["reward"][:, 0]
    np.testing.assert_allclose(returns, native, rtol=1e-12)


def test_policies_are_told_of_new_episodes_and_see_the_last_action() -> None:
    world = make(2, max_episode_steps=4)
    policy = Spring()
    world.set_policy(policy)
    assert policy.envs is world.envs
    world.evaluate(episodes=5, seed=0)
    # Two environments run episodes 0, 1 and 2, 3, then one runs 4 and the other is over.
    np.testing.assert_array_equal(policy.begun, [[True, True], [True, False]])
    steps = np.stack(policy.steps)
    np.testing.assert_array_equal(steps[:8], [[t % 4] * 2 for t in range(8)])
    np.testing.assert_array_equal(steps[8:, 0], [0, 1, 2, 3])
    actions = np.stack(policy.actions)
    assert np.isnan(actions[[0, 4]]).all() and not np.isnan(actions[[1, 2, 3, 5, 6, 7]]).any()
    assert world.infos["terminated"].all(), "nobody runs any more"


def test_the_reset_flag_is_gone_where_nobody_takes_it() -> None:
    class Looks:
        def __init__(self) -> None:
            self.seen: list[bool] = []

        def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
            self.seen.append("_needs_flush" in infos)
            return np.zeros((1, 2))

    world = make(1, max_episode_steps=3)
    policy = Looks()
    world.set_policy(policy)
    world.evaluate(episodes=2, seed=0)
    assert policy.seen == [False, False, False, True, False, False]


def test_names_and_arguments_of_native_policies(tmp_path: Path) -> None:
    native = swm.NativePolicy
    assert native("random").text == "random"
    assert native("cem", samples=300, clip=True).text == "cem:samples=300,clip=true"
    assert native("cem:samples=3", horizon=2).text == "cem:samples=3,horizon=2"
    file = tmp_path / "cem.json"
    file.write_text('{"samples": 8, "elites": 2}')
    assert native(f"cem:@{file}", elites=4).text == "cem:samples=8,elites=4"
    world = make(1)
    with pytest.raises(swm.PolicyError, match="did you mean `random`"):
        world.set_policy("randon")
    with pytest.raises(swm.PolicyError, match="sampels"):
        world.set_policy("cem:sampels=3")


def test_seeds_of_a_policys_own_noise() -> None:
    world = make(2)

    def returns(seed: int) -> np.ndarray:
        world.set_policy("random", seed=seed)
        return world.evaluate(episodes=3, seed=5)["episode_returns"]

    np.testing.assert_array_equal(returns(1), returns(1))
    assert not np.array_equal(returns(1), returns(2))


def test_policies_with_a_seed_are_seeded() -> None:
    class Seeded(Spring):
        seed = 11

        def _set_seed(self, seed: int) -> None:
            self.given = seed

    policy = Seeded()
    make(1).set_policy(policy)
    assert policy.given == 11


def test_tensors_are_actions() -> None:
    torch = pytest.importorskip("torch")

    class Tensors:
        def get_action(self, infos: dict[str, np.ndarray]) -> object:
            return torch.zeros((2, 2), dtype=torch.float64, requires_grad=True)

    world = make(2, max_episode_steps=5)
    world.set_policy(Tensors())
    tensors = world.evaluate(episodes=2, seed=0)
    world.set_policy("constant")
    np.testing.assert_array_equal(tensors["episode_returns"], world.evaluate(episodes=2, seed=0)["episode_returns"])
