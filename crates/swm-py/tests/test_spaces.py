"""Spaces that keep a value, and those built from environments."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from stable_worldmodel_rs import _swm, spaces
from stable_worldmodel_rs.world.ids import env_ids

World = Callable[..., Any]


def tree() -> spaces.Dict:
    return spaces.Dict(
        {
            "agent": spaces.Dict(
                {
                    "color": spaces.RGBBox(init_value=np.array([1, 2, 3], np.uint8)),
                    "shape": spaces.Discrete(4, init_value=1),
                }
            ),
            "scale": spaces.Box(0.5, 2.0, (), np.float64, init_value=np.array(1.0)),
        }
    )


def test_a_leaf_samples_holds_and_resets_its_value() -> None:
    space = spaces.Discrete(5, start=2, init_value=3, seed=0)
    assert (space.value, space.init_value) == (3, 3)
    sampled = space.sample()
    assert space.value == sampled and 2 <= sampled < 7
    space.sample(set_value=False)
    assert space.value == sampled
    space.reset()
    assert space.value == 3
    with pytest.raises(ValueError, match="9"):
        space.set_value(9)


def test_constraints_are_kept_by_rejection() -> None:
    space = spaces.MultiDiscrete([5, 5], init_value=np.array([1, 1]), constrain_fn=lambda x: x[0] == x[1], seed=1)
    for _ in range(20):
        first, second = space.sample()
        assert first == second
    assert not space.contains(np.array([1, 2]))
    never = spaces.Box(0, 1, (1,), constrain_fn=lambda x: False)
    with pytest.raises(RuntimeError, match="constrain_fn not satisfied after 7 samples"):
        never.sample(max_tries=7)


def test_dotted_names_reach_into_nested_spaces() -> None:
    space = tree()
    assert space.names() == ["agent.color", "agent.shape", "scale"]
    assert space.sampling_order == ["agent", "agent.color", "agent.shape", "scale"]
    space.set_value({"agent.shape": 2})
    assert space["agent"]["shape"].value == 2
    space.update(["agent.color"])
    assert space["agent"]["shape"].value == 2
    space.reset()
    np.testing.assert_array_equal(space.value["agent"]["color"], [1, 2, 3])
    for change in (space.set_value, space.set_init_value):
        with pytest.raises(ValueError, match="not found.*agent.color"):
            change({"agent.colr": 1})
    with pytest.raises(ValueError, match="not found"):
        space.update(["nothing"])


def test_values_survive_pickle_and_copies() -> None:
    space = tree()
    space.set_value({"agent.shape": 3})
    for again in (copy.deepcopy(space), pickle.loads(pickle.dumps(space))):
        assert again["agent"]["shape"].value == 3 and again.check()


def test_reset_variation_space_repeats_a_seed() -> None:
    first, second = tree(), tree()
    for space in (first, second):
        spaces.reset_variation_space(
            space, seed=5, options={"variation": ["scale"], "variation_values": {"agent.shape": 0}}
        )
    assert first.value["scale"] == second.value["scale"] != 1.0
    assert first.value["agent"]["shape"] == 0
    with pytest.raises(ValueError, match="Sequence"):
        spaces.reset_variation_space(first, options={"variation": {"scale"}})


_ON_MUJOCO = ("DMControl", "OGB", "Fetch")


@pytest.mark.parametrize("name", [name for name in env_ids() if not any(part in name for part in _ON_MUJOCO)])
def test_spaces_of_an_environment_hold_what_it_gives(name: str, world: World) -> None:
    made = world(name.replace("swm/", "swm_rs/"))
    made.reset(seed=1, options={"variation": ["all"]})
    pool = made.envs
    assert isinstance(pool.single_action_space, gym.Space)
    assert pool.action_space.shape is None or pool.action_space.shape[0] == 2
    for row in range(2):
        space = pool.envs[row].variation_space
        assert space.check(debug=True)
        for factor in space.names():
            leaf: Any = space
            for part in factor.split("."):
                leaf = leaf[part]
            np.testing.assert_array_equal(leaf.value, made.infos[f"variation.{factor}"][row, 0])
    observed = pool.single_observation_space
    for column, inner in observed.spaces.items():
        assert inner.contains(made.infos[column][0, 0].reshape(inner.shape)), column


def test_defaults_of_factors_lie_in_their_spaces(world: World) -> None:
    assert world().envs.variation_space.check(debug=True)


def test_set_values_show_in_the_space(world: World) -> None:
    made = world()
    made.reset(seed=0, options={"variation_values": {"agent.color": [255, 0, 7]}})
    np.testing.assert_array_equal(made.envs.envs[1].unwrapped.variation_space["agent"]["color"].value, [255, 0, 7])


def test_infinite_bounds_come_through() -> None:
    action = {"kind": "box", "dtype": "f64", "shape": [2], "low": [None, 0.0], "high": [1.0, None]}
    space = spaces.action_space({"action": action})
    assert isinstance(space, gym.spaces.Box) and space.dtype == np.float64
    np.testing.assert_array_equal(space.low, [-np.inf, 0.0])
    np.testing.assert_array_equal(space.high, [1.0, np.inf])


def test_errors_are_value_errors_of_the_package() -> None:
    assert issubclass(_swm.SwmError, ValueError)
    with pytest.raises(gym.error.NameNotFound, match="swm/PushT-v1"):
        _swm.World("swm/PushTT-v1", 1)
