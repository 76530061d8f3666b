"""Wrong inputs of a first week, from Python without torch: worlds, evaluations, datasets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import stable_worldmodel_rs as swm


def world(**options: Any) -> swm.World:
    options = {"add_pixels": False, "max_episode_steps": 6, "threads": 1, **options}
    live = swm.World("swm/PushT-v1", num_envs=options.pop("num_envs", 2), **options)
    live.set_policy("random")
    return live


def recording(folder: Path, name: str = "pusht.h5", env: str = "swm/PushT-v1") -> Path:
    live = swm.World(env, num_envs=1, image_shape=(32, 32), max_episode_steps=10, threads=1)
    live.set_policy("random")
    live.collect(folder / name, episodes=3, seed=0, progress=False)
    return folder / name


def unknown_option(_: Path) -> None:
    world().reset(seed=0, options={"variations": ["agent.color"]})


def color_beyond_its_range(_: Path) -> None:
    world().reset(seed=0, options={"variation_values": {"agent.color": [300, 0, 0]}})


def no_episodes(_: Path) -> None:
    world().evaluate(episodes=0, seed=0)


def no_steps_per_episode(_: Path) -> None:
    world(max_episode_steps=0).evaluate(episodes=1, seed=0)


def no_frame_skip(_: Path) -> None:
    world(frame_skip=0).evaluate(episodes=1, seed=0)


def actions_of_one_environment(_: Path) -> None:
    live = world()
    live.reset(seed=0)
    live.step(np.zeros((1, 2), np.float32))


def step_before_reset(_: Path) -> None:
    world().step(np.zeros((2, 2), np.float32))


def suffix_of_another_format(folder: Path) -> None:
    world().collect(folder / "a.mcap", episodes=1, seed=0, format="hdf5", progress=False)


def goal_beyond_the_episode(folder: Path) -> None:
    swm.evaluate_from_dataset(world(), recording(folder), [0], [8], goal_offset=25, eval_budget=3)


def dataset_of_another_environment(folder: Path) -> None:
    path = recording(folder, env="swm/TwoRoom-v2")
    swm.evaluate_from_dataset(world(), path, [0], [0], goal_offset=2, eval_budget=3)


def rule_of_an_unknown_column(_: Path) -> None:
    rule = {"column": "block_pos", "goal": "goal_pose", "elements": [0, 1], "measure": "distance", "below": 20.0}
    world().set_success({"hold": 1, "all": [rule]})


def negative_probability(folder: Path) -> None:
    dataset = swm.data.load_dataset(recording(folder))
    swm.data.GoalDataset(dataset, goal_probabilities=(1.5, -0.5, 0.0, 0.0))[0]


def discount_above_one(folder: Path) -> None:
    dataset = swm.data.load_dataset(recording(folder))
    swm.data.GoalDataset(dataset, gamma=1.5)[0]


def goal_of_an_unknown_column(folder: Path) -> None:
    dataset = swm.data.load_dataset(recording(folder))
    swm.data.GoalDataset(dataset, goal_keys={"pixel": "goal"})


def episode_twice(folder: Path) -> None:
    swm.data.load_dataset(recording(folder), num_steps=2).subset([0, 0])


def episode_that_is_not_there(folder: Path) -> None:
    swm.data.load_dataset(recording(folder), num_steps=2).subset([7])


def actions_one_row_short(folder: Path) -> None:
    with swm.data.HDF5Writer(folder / "own.h5") as writer:
        writer.write_episode({"state": np.zeros((5, 3)), "action": np.zeros((4, 2))})


def rank_beyond_the_world(folder: Path) -> None:
    list(swm.data.Loader(recording(folder), batch_size=2, shard=(2, 2)))


def step_after_the_end(_: Path) -> None:
    live = world(max_episode_steps=2)
    live.reset(seed=0)
    for _ in range(4):
        live.step(np.zeros((2, 2), np.float32))


def seed_of_half(_: Path) -> None:
    world().reset(seed=1.5)


def size_of_a_copy_as_text(folder: Path) -> None:
    swm.data.convert(recording(folder), folder / "b.h5", image_size="8x8")


def size_of_images_as_text(folder: Path) -> None:
    swm.data.load_dataset(recording(folder)).resized("44", "stretch")


def overwriting_by_an_episode_without_rows(folder: Path) -> None:
    held = recording(folder)
    try:
        with swm.data.HDF5Writer(held, mode="overwrite") as writer:
            writer.write_episode({"a": np.zeros((0, 2))})
    finally:
        assert len(swm.data.load_dataset(held).lengths) == 3


def half_an_episode(_: Path) -> None:
    world().evaluate(episodes=2.5, seed=0)


def no_environments(_: Path) -> None:
    world(num_envs=-1)


def half_an_environment(_: Path) -> None:
    world(num_envs=2.0)


def episodes_and_a_total(folder: Path) -> None:
    world().collect(folder / "a.h5", episodes=2, total=4, progress=False)


def copy_to_an_unknown_format(folder: Path) -> None:
    swm.data.convert(recording(folder), folder / "copy.foo", progress=False)


def merge_of_one_path(folder: Path) -> None:
    swm.data.merge(str(recording(folder)), folder / "all.h5", progress=False)


def an_unknown_fit(folder: Path) -> None:
    swm.data.convert(recording(folder), folder / "copy.h5", image_size=(16, 16), fit="cropp", progress=False)


def half_a_clip(folder: Path) -> None:
    swm.data.load_dataset(recording(folder))[1.5]


def clips_by_slice(folder: Path) -> None:
    swm.data.load_dataset(recording(folder))[0:3]


def image_size_of_a_manifest(folder: Path) -> None:
    swm.make_manifest(folder / "task.toml", "swm/PushT-v1", image_size=(64, 64))


INPUTS: list[tuple[Callable[[Path], Any], list[str]]] = [
    (unknown_option, ["no reset option `variations`", "it has variation,"]),
    (color_beyond_its_range, ["`agent.color`", "between 0 and 255, found 300"]),
    (no_episodes, ["episodes=0: give 1 or more"]),
    (no_steps_per_episode, ["max_episode_steps=0: give 1 or more"]),
    (no_frame_skip, ["frame_skip=0: give 1 or more"]),
    (actions_of_one_environment, ["shape [2, 2], one row per environment", "found float32 of shape [1, 2]"]),
    (step_before_reset, ["no episode has begun; call `reset`"]),
    (suffix_of_another_format, ["a.mcap: its name is that of the format mcap, and hdf5 is written"]),
    (goal_beyond_the_episode, ["episode 0 has 11 rows, too few for 26 from row 8 on"]),
    (dataset_of_another_environment, ["`swm/TwoRoom-v2`", "`swm/PushT-v1`"]),
    (rule_of_an_unknown_column, ["`block_pos`", "did you mean `block_pose`?"]),
    (negative_probability, ["goal_probabilities must be 0 or more, not (1.5, -0.5, 0.0, 0.0)"]),
    (discount_above_one, ["gamma must be from 0 to 1, not 1.5"]),
    (goal_of_an_unknown_column, ["goal_keys: there is no column 'pixel'", "'pixels'"]),
    (episode_twice, ["has episodes more than once: 0"]),
    (episode_that_is_not_there, ["pusht.h5: there is no episode 7; there are 3, counted from 0"]),
    (actions_one_row_short, ["column `action` has 4 rows, the others have 5"]),
    (rank_beyond_the_world, ["`shard`: rank 2 of 2"]),
    (step_after_the_end, ["episodes of all environments that it would step are over; call `reset`"]),
    (seed_of_half, ["seed", "1.5"]),
    (size_of_a_copy_as_text, ["image_size='8x8': give the height and width", "image_size=(64, 64)"]),
    (size_of_images_as_text, ["image_size='44': give the height and width"]),
    (overwriting_by_an_episode_without_rows, ["an episode without rows"]),
    (half_an_episode, ["episodes=2.5: give a whole number from 1 on"]),
    (no_environments, ["num_envs=-1; give 1 or more"]),
    (half_an_environment, ["num_envs=2.0; give a whole number"]),
    (episodes_and_a_total, ["episodes=2 and total=4; leave one of them out"]),
    (copy_to_an_unknown_format, ["copy.foo: unknown format 'foo'", 'dest_format="hdf5"']),
    (merge_of_one_path, ["merge takes a list of datasets"]),
    (an_unknown_fit, ['fit="cropp"', "did you mean `crop`?"]),
    (half_a_clip, ["dataset[1.5]: clips have whole numbers"]),
    (clips_by_slice, ["dataset[slice(0, 3, None)]: clips have whole numbers"]),
    (image_size_of_a_manifest, ["did you mean image_shape=(64, 64)?"]),
]
