"""Worlds of environments that are Python objects: of gymnasium by id, and of functions."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs.world.wrap import InfoWrapper, resized

NAME = "swm_test/Walk-v0"


class Walk(gym.Env[dict[str, np.ndarray], np.ndarray]):
    """A point that walks right: it is done at 3."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 30}

    def __init__(self, render_mode: str | None = None, speed: float = 1.0) -> None:
        self.render_mode = render_mode
        self.observation_space = gym.spaces.Dict({"position": gym.spaces.Box(-10, 10, (1,), np.float64)})
        self.action_space = gym.spaces.Box(-1, 1, (2,), np.float32)
        self.speed = speed
        self.position = 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self.position = float((options or {}).get("start", 0.0))
        return self._observe(), {"goal": np.full((20, 30, 3), 9, np.uint8)}

    def step(self, action: np.ndarray) -> Any:
        self.position += self.speed * float(action[0])
        return self._observe(), -1.0, self.position >= 3, False, {"goal": np.full((20, 30, 3), 9, np.uint8)}

    def _observe(self) -> dict[str, np.ndarray]:
        return {"position": np.array([self.position])}

    def render(self) -> np.ndarray:
        return np.full((20, 30, 3), int(self.position * 10), np.uint8)

    def reset_options_from_dataset(self, init_row: dict[str, Any], goal_row: dict[str, Any]) -> dict[str, Any]:
        assert "goal_position" in goal_row
        return {"start": float(init_row["position"][0])}


class Right:
    """Walks right."""

    def set_env(self, envs: Any) -> None:
        self.count = envs.num_envs

    def get_action(self, infos: dict[str, Any]) -> np.ndarray:
        return np.tile(np.float32([1, 0]), (self.count, 1))


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    gym.register(NAME, entry_point=Walk)
    yield
    del gym.registry[NAME]


def make(num_envs: int = 2, **kwargs: Any) -> swm.World:
    return swm.World(NAME, num_envs, image_shape=(8, 10), max_episode_steps=6, **kwargs)


def test_infos_hold_everything() -> None:
    world = make()
    world.reset(seed=3)
    assert world.infos["pixels"].shape == (2, 1, 8, 10, 3) and world.infos["goal"].shape == (2, 1, 8, 10, 3)
    assert world.infos["position"].shape == (2, 1, 1)
    assert np.isnan(world.infos["action"]).all() and np.isnan(world.infos["reward"]).all()
    world.step(np.ones((2, 2)))
    assert (world.infos["step_idx"] == 1).all() and (world.infos["reward"] == -1).all()
    assert (world.infos["pixels"] == 10).all()
    assert world.rewards is not None and world.rewards.tolist() == [-1, -1]
    assert "goal" not in make(goal_conditioned=False).envs.reset()[1]
    assert f"environment: {NAME}," in repr(world) and "<table>" in world._repr_html_()


def test_evaluations_and_their_videos(tmp_path: Path) -> None:
    world = make(speed=1.0)
    world.set_policy(Right())
    result = world.evaluate(episodes=5, seed=0, video=tmp_path)
    assert result["success_rate"] == 100.0 and result["seeds"].tolist() == [0, 1, 2, 3, 4]
    assert result["interval"][0] > 40 and "100.0 %" in repr(result)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"episode_{i}.mp4" for i in range(5)]
    slow = make(speed=0.1)
    slow.set_policy(Right())
    assert slow.evaluate(episodes=2, seed=0, reset_mode="wait")["success_rate"] == 0.0


def test_episodes_are_recorded_and_started_from(tmp_path: Path) -> None:
    world = make()
    world.set_policy(Right())
    path = tmp_path / "walk.h5"
    report = world.collect(path, episodes=3, seed=0, progress=False)
    assert report == {"path": str(path), "episodes": 3, "total_episodes": 3, "steps": 12}
    dataset = swm.data.load_dataset(str(path))
    assert dataset.lengths.tolist() == [4, 4, 4]
    position = np.asarray(dataset.load_episode(0)["position"])
    np.testing.assert_array_equal(position[:, 0], [0, 1, 2, 3])
    assert np.isnan(np.asarray(dataset.load_episode(0)["action"])[-1]).all()
    result = world.evaluate(
        dataset=dataset, episodes_idx=[0, 1], start_steps=[0, 2], goal_offset=1, eval_budget=1, video=tmp_path / "v"
    )
    assert result["episode_successes"].tolist() == [False, True]
    assert len(list((tmp_path / "v").iterdir())) == 2
    with pytest.raises(ValueError, match="1 pairs for 2 environments"):
        world.evaluate(dataset=dataset, episodes_idx=[0], start_steps=[0], goal_offset=1, eval_budget=1)


def test_recordings_name_their_environment_and_policy(tmp_path: Path) -> None:
    by_id, by_class = tmp_path / "id.h5", tmp_path / "class.h5"
    worlds = {by_id: make(1), by_class: swm.World([Walk], image_shape=(8, 10), max_episode_steps=6)}
    for path, world in worlds.items():
        world.set_policy(Right())
        world.collect(path, episodes=2, seed=3, progress=False)
    told = {path: swm.data.load_dataset(path).metadata for path in worlds}
    assert [told[path]["env"] for path in worlds] == [NAME, "Walk"]
    assert all(one["policy"] == "Right" and one["seed"] == 3 for one in told.values())
    # Of this package's own environments, the id is that of the core.
    for made in (lambda: gym.make("swm_rs/TwoRoom-v2"), lambda: swm.envs.Env("swm/TwoRoom-v2")):
        own = swm.World([made], image_shape=None, max_episode_steps=5)
        own.set_policy("random")
        own.collect(tmp_path / "own.h5", episodes=1, seed=0, mode="overwrite", progress=False)
        assert swm.data.load_dataset(tmp_path / "own.h5").metadata["env"] == "swm/TwoRoom-v2"
    with pytest.raises(swm.SwmError, match="was recorded in `Walk`, an environment of another program.*give env_name if this program has"):
        swm.replay(by_class, progress=False)
    command = [sys.executable, "-m", "stable_worldmodel_rs", "replay", str(by_class)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "recorded in `Walk`, an environment of another program" in done.stderr, done.stderr
    assert "give --env if this program has" in done.stderr
    worlds[by_class].collect(by_class, episodes=1, seed=9, mode="append", progress=False)
    assert len(swm.data.load_dataset(by_class).lengths) == 3
    with swm.data.HDF5Writer(tmp_path / "plain.h5") as writer:
        writer.write_episode({"action": np.zeros((3, 2), np.float32)})
    with pytest.raises(swm.SwmError, match="plain.h5 does not name its environment; give env_name"):
        swm.replay(tmp_path / "plain.h5", progress=False)


def test_collecting_says_what_was_written(tmp_path: Path) -> None:
    world = make()
    world.set_policy(Right())
    path = tmp_path / "walk.lerobot"
    world.collect(path, episodes=2, seed=0, progress=False)
    more = world.collect(path, episodes=1, seed=1, mode="append", progress=False)
    assert more == {"path": str(path), "episodes": 1, "total_episodes": 3, "steps": 4}
    buffer = swm.data.ReplayBuffer(max_steps=100)
    report = world.collect(writer=buffer, episodes=2, seed=0, progress=False)
    assert report == {"path": None, "episodes": 2, "total_episodes": 2, "steps": 8}


class Growing(Walk):
    """Its observation has an element more at every step; ``longer`` at the reset."""

    def __init__(self, longer: int = 0) -> None:
        super().__init__()
        self.longer = longer

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        _, info = super().reset(seed=seed, options=options)
        return {"position": np.zeros(2 + self.longer)}, info

    def step(self, action: np.ndarray) -> Any:
        _, *results = super().step(action)
        return {"position": np.zeros(3 + self.longer)}, *results


def test_wrong_shapes_name_the_field_and_both_shapes() -> None:
    world = make(3, add_pixels=False)
    world.reset(seed=0)
    for wrong in (np.ones(2, np.float32), np.ones((2, 2), np.float32)):
        with pytest.raises(ValueError, match=r"actions has the shape \(2,.*\(3, 2\) is needed: one row for each of the 3"):
            world.step(wrong)
    world = swm.World([Growing], add_pixels=False)
    world.reset(seed=0)
    with pytest.raises(ValueError, match=r"`position` of environment 0 has the shape \(3,\), and had \(2,\)"):
        world.step(np.ones((1, 2), np.float32))
    world = swm.World([Growing, lambda: Growing(longer=2)], add_pixels=False)
    with pytest.raises(ValueError, match=r"`position` has the shape \(2,\) in environment 0 and \(4,\) in environment 1"):
        world.reset(seed=0)


def test_functions_make_environments_as_they_are() -> None:
    world = swm.World([lambda: InfoWrapper(Walk()), lambda: InfoWrapper(Walk(speed=3.0))])
    world.set_policy(Right())
    assert world.num_envs == 2
    world.reset(seed=0)
    world.step()
    assert world.infos["position"].ravel().tolist() == [1, 3] and world.terminateds.tolist() == [False, True]


def test_wrappers_surround_the_one_that_completes_infos() -> None:
    seen: list[str] = []

    class Notes(gym.Wrapper[Any, Any, Any, Any]):
        def step(self, action: Any) -> Any:
            result = self.env.step(action)
            seen.append("pixels" if "pixels" in result[4] else "plain")
            return result

    world = make(1, pre_wrappers=[Notes], extra_wrappers=[Notes])
    world.reset(seed=0)
    world.step(np.ones((1, 2)))
    assert seen == ["plain", "pixels"]


def test_transforms_are_applied_to_each_image() -> None:
    world = make(1, image_transform=lambda image: image.astype(np.float32) / 10, goal_transform=lambda image: image[:1])
    world.reset(seed=0)
    world.step(np.ones((1, 2)))
    assert world.infos["pixels"].dtype == np.float32 and (world.infos["pixels"] == 1).all()
    assert world.infos["goal"].shape == (1, 1, 1, 10, 3)


def test_images_are_resized() -> None:
    image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    assert resized(image, (4, 4)) is image
    assert resized(image, (2, 2), "nearest").tolist() == image[1::2, 1::2].tolist()
    flat = np.full((5, 7, 3), 200, np.uint8)
    assert (resized(flat, (3, 11)) == 200).all()
    half = resized(np.repeat(np.uint8([0, 100]), 8).reshape(1, 16, 1).repeat(3, 2), (1, 2))
    assert half[0, 0, 0] < 30 and half[0, 1, 0] > 70
    with pytest.raises(ValueError, match="bilinear"):
        resized(image, (2, 2), "lanczos")


def test_what_only_rust_environments_can_do_is_refused() -> None:
    world = make()
    with pytest.raises(TypeError, match="random"):
        world.set_policy("cem")
    with pytest.raises(TypeError, match="gymnasium"):
        world.set_success({})
    with pytest.raises(gym.error.NameNotFound):
        swm.World("swm/NoSuchThing-v0", 1, image_shape=(8, 8))


class Dot(gym.Env[dict[str, Any], Any]):
    """An environment as users write it: a dict as observation, images by ``render``, nothing in the info."""

    observation_space = gym.spaces.Dict({"state": gym.spaces.Box(-9, 9, (2,), np.float32)})
    action_space = gym.spaces.Box(-1, 1, (2,), np.float32)

    def __init__(self, has_images: bool = True) -> None:
        self.render_mode = "rgb_array" if has_images else None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self.at = np.zeros(2, np.float32)
        return {"state": self.at.copy()}, {}

    def step(self, action: Any) -> Any:
        self.at += np.asarray(action, np.float32)
        return {"state": self.at.copy()}, float(self.at[0]), False, False, {}

    def render(self) -> Any:
        return np.full((8, 8, 3), 40, np.uint8) if self.render_mode else None


def test_environments_of_functions_are_recorded_whole(tmp_path: Path) -> None:
    world = swm.World([Dot, Dot], image_shape=(16, 16), max_episode_steps=5)
    world.reset(seed=0)
    assert world.infos["pixels"].shape == (2, 1, 16, 16, 3) and world.infos["state"].shape == (2, 1, 2)

    def right(infos: dict[str, Any]) -> Any:
        return np.tile(np.float32([1, 0]), (len(infos["state"]), 1))

    for policy in (right, "random"):
        world.set_policy(policy)
        path = tmp_path / f"{policy if isinstance(policy, str) else 'function'}.h5"
        world.collect(path, episodes=3, seed=0, progress=False)
        dataset = swm.data.load_dataset(str(path))
        assert {"state", "pixels", "action", "reward", "terminated"} <= set(dataset.column_names)
        assert dataset.lengths.tolist() == [6, 6, 6], "the limit of the World holds for them"
    world.set_policy(right)
    assert world.policy.describe() == "right"
    world.collect(tmp_path / "again.h5", episodes=1, seed=0, progress=False)
    state = np.asarray(swm.data.load_dataset(str(tmp_path / "again.h5")).load_episode(0)["state"])
    np.testing.assert_array_equal(state[:, 0], [0, 1, 2, 3, 4, 5])


def test_results_and_worlds_name_environment_and_policy() -> None:
    for world, name in ((make(1), NAME), (swm.World([Dot], add_pixels=False, max_episode_steps=2), "Dot")):
        world.set_policy(Right())
        result = world.evaluate(episodes=1, seed=0)
        assert result["setup"] == {"env": name, "policy": "Right"}
        assert f"environment: {name}" in repr(world) and f"environment: {name}" in repr(result) and "policy: Right" in repr(result)


class OldStep(Dot):
    def step(self, action: Any) -> Any:
        observation, reward, done, _, info = super().step(action)
        return observation, reward, done, info


class OldReset(Dot):
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        return super().reset(seed=seed)[0]


class NoInfo(Dot):
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        return super().reset(seed=seed)[0], None


class NoSeed(Dot):
    def reset(self) -> Any:  # type: ignore[override]
        return super().reset()


class NoSpace(Dot):
    observation_space = None  # type: ignore[assignment]


class NoSpaces:
    """An environment that is no `gymnasium.Env`, and has no spaces."""


OLD: list[tuple[Any, str]] = [
    (OldStep, r"`step` of <OldStep.*returned 4 values; return observation, reward, terminated, truncated, info, .*`done` of older interfaces"),
    (OldReset, r"`reset` of <OldReset.*returned dict; return observation, info, where info is a dict"),
    (NoInfo, r"`reset` of <NoInfo.*returned NoneType as the info; return observation, info"),
    (NoSeed, r"unexpected keyword argument 'seed', of <NoSeed.*: define reset\(self, \*, seed=None, options=None\)"),
    (NoSpace, r"<NoSpace.*: `observation_space` is NoneType; set it to a space, such as gymnasium.spaces.Box"),
    (NoSpaces, r"NoSpaces.*: `observation_space` is NoneType; set it to a space"),
    (lambda: None, "returned None; end it with `return`"),
]


@pytest.mark.parametrize(("make_env", "said"), OLD)
def test_environments_of_an_older_interface_are_named_with_the_fix(make_env: Any, said: str) -> None:
    for limit in (None, 5):
        with pytest.raises(TypeError, match=said):
            world = swm.World([make_env], add_pixels=False, max_episode_steps=limit)
            world.reset(seed=0)
            world.step(np.zeros((1, 2), np.float32))


@pytest.mark.parametrize("shape", [(8, 8), (8, 8, 4), (2, 8, 8, 3)])
def test_what_is_rendered_and_no_image_is_refused(shape: tuple[int, ...]) -> None:
    class Gray(Dot):
        def render(self) -> Any:
            return np.full(shape, 40, np.uint8)

    with pytest.raises(ValueError, match=rf"Gray.* renders uint8 of shape {re.escape(str(list(shape)))}, which is no image; render \[H, W, 3\].*np.repeat"):
        swm.World([Gray], image_shape=(8, 8)).reset(seed=0)
    world = swm.World([Gray], image_shape=(8, 8), image_transform=lambda image: np.zeros((8, 8, 3), np.uint8))
    world.reset(seed=0)
    assert world.infos["pixels"].shape == (1, 1, 8, 8, 3)


def test_lists_of_what_makes_no_environment_are_refused() -> None:
    with pytest.raises(TypeError, match=r"give the id alone, and how many: World\('swm/PushT-v1', num_envs=1\)"):
        swm.World(["swm/PushT-v1"])  # type: ignore[list-item]
    with pytest.raises(TypeError, match=r"an object of Dot; give functions that each make an environment: \[Dot\] \* 2"):
        swm.World([Dot(), Dot()])  # type: ignore[list-item]


def test_what_cannot_be_done_with_them_is_said() -> None:
    world = swm.World([Dot], add_pixels=False)
    with pytest.raises(TypeError, match="'random', a function of the infos"):
        world.set_policy("expert")
    with pytest.raises(TypeError, match=r"make one: Right\(\)"):
        world.set_policy(Right)
    with pytest.raises(TypeError, match="a function of the infos, or an object with get_action"):
        world.set_policy(3)
    blind = swm.World([lambda: Dot(has_images=False)], image_shape=(16, 16))
    with pytest.raises(ValueError, match="render_mode='rgb_array'"):
        blind.reset(seed=0)
