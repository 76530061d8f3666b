"""`World`: infos, resets, steps, factors, and what is refused."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm


def make(num_envs: int = 3, **kwargs: object) -> swm.World:
    return swm.World("swm/PushT-v1", num_envs, image_shape=(32, 32), threads=1, **kwargs)


def test_infos_have_the_references_shapes_and_types() -> None:
    world = make()
    world.reset(seed=42)
    expected = {
        "pixels": ((3, 1, 32, 32, 3), np.uint8),
        "goal": ((3, 1, 32, 32, 3), np.uint8),
        "state": ((3, 1, 7), np.float64),
        "proprio": ((3, 1, 4), np.float64),
        "goal_state": ((3, 1, 7), np.float64),
        "action": ((3, 1, 2), np.float32),
        "reward": ((3, 1), np.float64),
        "terminated": ((3, 1), np.bool_),
        "truncated": ((3, 1), np.bool_),
        "step_idx": ((3, 1), np.int64),
        "seed": ((3, 1), np.int64),
        "id": ((3, 1), np.int64),
    }
    for name, (shape, dtype) in expected.items():
        assert world.infos[name].shape == shape, name
        assert world.infos[name].dtype == dtype, name
    assert world.infos["env_name"] == [["swm/PushT-v1"]] * 3
    assert np.isnan(world.infos["action"]).all()
    assert np.isnan(world.infos["reward"]).all()
    assert world.terminateds is not None and not world.terminateds.any()


def test_arrays_stay_the_same_and_are_written_in_place() -> None:
    world = make()
    world.reset(seed=0)
    infos, state = world.infos, world.infos["state"]
    before = state.copy()
    actions = np.linspace(-1, 1, 6).reshape(3, 2)
    world.step(actions)
    assert world.infos is infos and world.infos["state"] is state
    assert not np.array_equal(before, state)
    np.testing.assert_array_equal(world.infos["action"][:, 0], actions.astype(np.float32))
    np.testing.assert_array_equal(world.infos["step_idx"][:, 0], [1, 1, 1])
    assert world.rewards is not None and world.rewards.dtype == np.float32
    np.testing.assert_array_equal(world.rewards, world.infos["reward"][:, 0].astype(np.float32))


def test_results_of_a_step_are_kept_by_who_keeps_them() -> None:
    world = make()
    world.reset(seed=0)
    world.step(np.ones((3, 2)))
    first = world.rewards
    kept = first.copy()
    world.step(-np.ones((3, 2)))
    np.testing.assert_array_equal(first, kept)
    assert not np.array_equal(world.rewards, kept)


def test_a_seed_names_the_episodes_whatever_the_number_of_environments() -> None:
    four, two = make(4), make(2)
    four.reset(seed=7)
    two.reset(seed=7)
    np.testing.assert_array_equal(four.infos["state"][:2], two.infos["state"])
    np.testing.assert_array_equal(four.infos["seed"][:, 0], [_swm.episode_seed(7, i) for i in range(4)])
    # Without a seed come the next episodes of the run.
    two.reset()
    np.testing.assert_array_equal(two.infos["state"], four.infos["state"][2:])
    # A list names the episodes' own seeds.
    again = make(1)
    again.reset(seed=[int(four.infos["seed"][2, 0])])
    np.testing.assert_array_equal(again.infos["state"], four.infos["state"][2:3])


def test_masks_reset_and_step_some_environments() -> None:
    world = make()
    world.reset(seed=0)
    mask = np.array([True, False, True])
    _, rewards, terminateds, truncateds, infos = world.envs.step(np.full((3, 2), 0.5), mask=mask)
    np.testing.assert_array_equal(infos["step_idx"][:, 0], [1, 0, 1])
    assert rewards[1] == 0 and rewards[0] != 0 and not terminateds.any() and not truncateds.any()
    world.envs.step(np.array([[np.nan, np.nan], [0.1, 0.1], [np.nan, np.nan]]), mask=~mask)
    np.testing.assert_array_equal(infos["step_idx"][:, 0], [1, 1, 1])
    _, infos = world.envs.reset(seed=[None, 99, None], mask=[False, True, False])
    np.testing.assert_array_equal(infos["step_idx"][:, 0], [1, 0, 1])
    assert infos["seed"][1, 0] == 99 and world.envs.seeds[1] == 99
    assert np.isnan(infos["action"][1]).all() and not np.isnan(infos["action"][0]).any()


def test_environments_that_are_over_stand_still_and_a_step_of_none_is_refused() -> None:
    world = make(2, max_episode_steps=2)
    world.reset(seed=0)
    for _ in range(2):
        world.envs.step(np.zeros((2, 2)), mask=[True, False])
    state = world.infos["state"].copy()
    world.step(np.array([[np.nan, np.nan], [0.1, 0.1]]))
    np.testing.assert_array_equal(world.infos["state"][0], state[0])
    assert not np.array_equal(world.infos["state"][1], state[1])
    assert world.infos["truncated"].ravel().tolist() == [True, False]
    assert not world.truncateds.any() and world.rewards[0] == 0 != world.rewards[1]
    world.step(np.zeros((2, 2)))
    assert world.truncateds.tolist() == [False, True]
    world.set_policy("random")
    for step in (lambda: world.step(np.zeros((2, 2))), world.step, lambda: world.envs.step(np.zeros((2, 2)), [True, False])):
        with pytest.raises(swm.EnvError, match="are over; call `reset` before the next step"):
            step()
        assert world.truncateds.tolist() == [False, True], "what the last step gave stays"
    world.reset()
    world.step()


def test_factors_are_sampled_set_and_shown() -> None:
    world = make(2)
    wrongs: list[Any] = ["x", [3]]
    for wrong in wrongs:
        with pytest.raises(TypeError, match="options: (str|int) in the place of a dict"):
            world.reset(seed=1, options=wrong)
    world.reset(seed=1, options={"variation": ["agent.color"]})
    assert [name for name in world.infos if name.startswith("variation.")] == ["variation.agent.color"]
    sampled = world.infos["variation.agent.color"][:, 0]
    assert not np.array_equal(sampled[0], sampled[1])
    space = world.envs.envs[1].unwrapped.variation_space
    np.testing.assert_array_equal(space["agent"]["color"].value, sampled[1])
    world.reset(seed=1, options={"variation": [], "variation_values": {"agent.color": [255, 0, 0]}})
    np.testing.assert_array_equal(world.infos["variation.agent.color"][:, 0], [[255, 0, 0]] * 2)
    for red in ("red", "#ff0000"):
        world.reset(seed=1, options={"variation": [], "variation_values": {"agent.color": red}})
        np.testing.assert_array_equal(world.infos["variation.agent.color"][:, 0], [[255, 0, 0]] * 2)
    with pytest.raises(swm.SwmError, match="`reddish` is no color"):
        world.reset(seed=1, options={"variation": [], "variation_values": {"agent.color": "reddish"}})
    world.reset(seed=1, options={"variation": "all"})
    assert "variation.block.color" in world.infos


def test_factors_are_chosen_by_the_rules_of_the_command() -> None:
    world = make(1)
    world.reset(seed=0, options={"variation": ["*.color", "default"]})
    shown = {name for name in world.infos if name.startswith("variation.")}
    assert {"variation.agent.color", "variation.block.color", "variation.block.start_position"} <= shown
    assert "variation.block.scale" not in shown


def test_policies_of_the_core_act_in_single_steps() -> None:
    world = make(2, max_episode_steps=4)
    world.set_policy("weak")
    with pytest.raises(swm.SwmError, match="reset"):
        world.step()
    actions = []
    world.reset(seed=5)
    for _ in range(4):
        world.step()
        actions.append(world.infos["action"].copy())
    assert np.isfinite(actions).all() and world.truncateds is not None and world.truncateds.all()
    assert len(np.unique(np.array(actions), axis=0)) == 4
    # The same episodes as in a run of the same seed.
    states = world.infos["state"].copy()
    world.evaluate(episodes=2, seed=5)
    np.testing.assert_array_equal(world.infos["state"], states)


def test_each_environment_may_have_options_of_its_own() -> None:
    world = make(2)
    states = [np.array([100.0, 120, 200, 210, 0.3, 0, 0]), np.array([300.0, 320, 220, 250, 1.3, 0, 0])]
    goals = [states[1], states[0]]
    options = [{"state": state, "goal_state": goal} for state, goal in zip(states, goals, strict=True)]
    world.reset(seed=0, options=options)
    np.testing.assert_allclose(world.infos["state"][:, 0, :5], np.stack(states)[:, :5])
    np.testing.assert_allclose(world.infos["goal_state"][:, 0, :5], np.stack(goals)[:, :5])


def test_options_may_be_any_mappings() -> None:
    world = make(1)
    values = MappingProxyType({"agent.color": [1, 2, 3]})
    world.reset(seed=0, options=MappingProxyType({"variation": (), "variation_values": values}))
    assert world.infos["variation.agent.color"].ravel().tolist() == [1, 2, 3]
    world.set_policy("random")
    assert world.evaluate(episodes=1, seed=0, options=MappingProxyType({"variation_values": values}))["episodes"] == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"variaton": ["all"]}, "no reset option `variaton`"),
        ({"variation": ["agent.colr"]}, "agent.colr"),
        ({"variation_values": {"agent.color": [300, 0, 0]}}, "agent.color"),
        ([{}], "1 dicts for 3 environments"),
    ],
)
def test_unusable_options_are_refused_with_the_fix(options: object, words: str) -> None:
    world = make()
    with pytest.raises(swm.SwmError, match=words.replace("(", r"\(")):
        world.reset(seed=0, options=options)


def test_unusable_actions_are_refused() -> None:
    world = make()
    with pytest.raises(swm.SwmError, match="call `reset`"):
        world.step(np.zeros((3, 2)))
    world.reset(seed=0)
    with pytest.raises(swm.SwmError, match=r"\[3, 2\]"):
        world.step(np.zeros((2, 2)))
    with pytest.raises(swm.PolicyError, match="not finite"):
        world.step(np.full((3, 2), np.nan))
    with pytest.raises(swm.SwmError, match="2 values for 3"):
        world.envs.step(np.zeros((3, 2)), mask=[True, False])
    with pytest.raises(swm.SwmError, match="seed=-1: give 0 or more"):
        world.reset(seed=-1)


def test_integers_lists_and_doubles_are_actions() -> None:
    worlds = [make(1) for _ in range(3)]
    for world, actions in zip(worlds, ([[1, 0]], np.array([[1, 0]]), np.array([[1.0, 0.0]])), strict=True):
        world.reset(seed=0)
        world.step(actions)
        np.testing.assert_array_equal(world.infos["state"], worlds[0].infos["state"])
    discrete = swm.World("swm/PushT-Discrete-v1", 2, add_pixels=False, threads=1)
    discrete.reset(seed=0)
    dtype = discrete.infos["action"].dtype
    assert dtype == np.int64 and (discrete.infos["action"] == -1).all()
    discrete.step(np.full(discrete.envs.action_space.shape, 3.0))
    assert (discrete.infos["action"] == 3).all()


def test_actions_of_other_types_are_taken_or_refused_by_name() -> None:
    def state(actions: object) -> np.ndarray:
        world = make(1)
        world.reset(seed=0)
        world.step(actions)
        return world.infos["state"].copy()

    given = np.array([[0.5, -0.25]])
    expected = state(given.astype(np.float32))
    for dtype in ("f2", ">f4", ">f8", "f8", "g"):
        np.testing.assert_array_equal(state(given.astype(dtype)), expected, err_msg=dtype)
    for dtype in (">i2", ">i8", "u8", "?"):
        np.testing.assert_array_equal(state(np.array([[1, 0]], dtype)), state([[1.0, 0.0]]), err_msg=dtype)
    world = make(1)
    world.reset(seed=0)
    for wrong, words in ((given.astype("c8"), "complex64"), (given.astype("U4"), "<U4"), (given.astype("O"), "object")):
        with pytest.raises(swm.SwmError, match=words):
            world.step(wrong)


def test_discrete_actions_are_whole_numbers() -> None:
    world = swm.World("swm/CartPoleControl-v1", 2, add_pixels=False, threads=1)
    world.reset(seed=0)
    for wrong, words in (([0.6, 0], "whole numbers, found 0.6"), ([2, 0], "not between"), ([np.nan, 0], "not between"), ([-1, 0], "not between")):
        with pytest.raises(swm.PolicyError, match=words):
            world.step(np.array(wrong))
    assert not world.infos["step_idx"].any()
    world.step(np.array([1.0, 0.0]))
    assert world.infos["action"].ravel().tolist() == [1, 0]
    world.envs.step(np.array([1.0, np.nan]), mask=[True, False])


def test_settings_frame_skip_and_images_reach_the_environments() -> None:
    fast = swm.World("swm/PushT-v1", 1, image_shape=(48, 64), render="fast", frame_skip=2, threads=1)
    fast.reset(seed=0)
    assert fast.infos["pixels"].shape == (1, 1, 48, 64, 3)
    plain = swm.World("swm/PushT-v1", 1, add_pixels=False, threads=1)
    plain.reset(seed=0)
    assert "pixels" not in plain.infos
    for _ in range(2):
        plain.step([[0.3, -0.2]])
    fast.step([[0.3, -0.2]])
    np.testing.assert_array_equal(fast.infos["state"], plain.infos["state"])
    with pytest.raises(swm.EnvError, match="no_such_setting"):
        swm.World("swm/PushT-v1", 1, add_pixels=False, no_such_setting=1)
    assert "goal" not in make(1, goal_conditioned=False).infos


def test_what_does_not_fit_rust_environments_is_refused() -> None:
    with pytest.raises(ValueError, match="image_shape is required"):
        swm.World("swm/PushT-v1", 1)
    with pytest.raises(TypeError, match="distractors="):
        make(1, pre_wrappers=[lambda env: env])
    with pytest.raises(swm.EnvError, match="num_envs"):
        make(0)
    world = make(1)
    with pytest.raises(TypeError, match="get_action"):
        world.set_policy(object())
    with pytest.raises(RuntimeError, match="No policy set"):
        world.evaluate(episodes=1)


def test_names_mean_the_environments_of_the_command() -> None:
    ids = swm.world.native_id
    assert ids("swm/TwoRoom-v1") == "swm/TwoRoom-v1" and ids("swm/TwoRoom-v2") == "swm/TwoRoom-v2"
    assert ids("swm_rs/TwoRoom-v1") == "swm/TwoRoom-v1"
    assert ids("swm/PushT-v1") == "swm/PushT-v1"
    assert ids("CartPole-v1") is None


def test_transforms_and_distractors_change_images() -> None:
    world = make(2, image_transform=lambda image: image.astype(np.float32) / 255)
    world.reset(seed=0)
    assert world.infos["pixels"].dtype == np.float32 and world.infos["pixels"].shape == (2, 1, 32, 32, 3)
    world.step(np.zeros((2, 2)))
    assert world.infos["pixels"].max() <= 1.0
    plain, changed = make(1), make(1, distractors=["noise"])
    plain.reset(seed=0)
    changed.reset(seed=0)
    np.testing.assert_array_equal(plain.infos["state"], changed.infos["state"])
    assert not np.array_equal(plain.infos["pixels"], changed.infos["pixels"])


def test_notebooks_show_worlds_and_results() -> None:
    world = make(2)
    assert "swm/PushT-v1" in repr(world) and "32×32" in repr(world)
    world.reset(seed=0)
    assert "data:image/png;base64" in world._repr_html_()
    world.set_policy("random")
    result = world.evaluate(episodes=2, seed=0)
    assert "random" in repr(result) and "<table>" in result._repr_html_()


def test_a_world_is_a_context_and_closes_twice() -> None:
    with make(1) as world:
        world.reset(seed=0)
    world.close()
    with pytest.raises(swm.SwmError, match="closed"):
        world.reset(seed=0)


def test_images_that_a_world_lacks_are_named(tmp_path: Path) -> None:
    world = swm.World("swm/PushT-v1", num_envs=1, add_pixels=False, max_episode_steps=2, threads=1)

    def seeing(infos: dict[str, Any]) -> Any:
        return infos["pixels"]

    world.set_policy(seeing)
    with pytest.raises(KeyError, match=r"the infos have no 'pixels'; make the World with image_shape=\(height, width\); they have .*state"):
        world.evaluate(episodes=1, seed=1, progress=False)
    world.set_policy("random")
    with pytest.raises(ValueError, match=r"a video needs images, and swm/PushT-v1 has none here; make .* image_shape=\(height, width\)"):
        world.evaluate(episodes=1, seed=1, progress=False, video=tmp_path / "videos")
    with pytest.raises(ValueError, match="a video needs images, and .*CartPole.* has none here"):
        cart = swm.World("CartPole-v1", num_envs=1, add_pixels=False, max_episode_steps=2)
        cart.set_policy("random")
        cart.evaluate(episodes=1, seed=1, progress=False, video=tmp_path / "videos")
    world.close()
