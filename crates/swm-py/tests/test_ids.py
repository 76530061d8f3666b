"""Ids of environments: those of the command, in every function; the reference's under `compat` alone; and ``swm/OGBMaze-v0``."""

from __future__ import annotations

import copy
import json
import logging
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import unquote

import gymnasium as gym
import numpy as np
import pytest
from data_makers import write

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm
from stable_worldmodel_rs.ui import Page
from stable_worldmodel_rs.world import foreign, ids
from stable_worldmodel_rs.world.mazes import maze_of

Run = Callable[..., Any]
LOGGER = "stable_worldmodel_rs"
PAPER, NEW = "swm/TwoRoom-v1", "swm/TwoRoom-v2"
SMALL: dict[str, Any] = {"episodes": 2, "rows": 6, "horizon": 2, "plans": 2, "progress": False}
INSTALL = "import logging; logging.basicConfig(format='NOTE %(message)s')\nimport stable_worldmodel_rs as ours\nours.compat.install()\n"


@pytest.fixture(autouse=True)
def first_of_a_process() -> Iterator[None]:
    ids._note.cache_clear()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*out of date.*")
        yield


def in_world(env: str, folder: Path) -> str:
    with swm.World(env, 1, add_pixels=False) as world:
        return world.infos["env_name"][0][0]


def in_gymnasium(env: str, folder: Path) -> str:
    return gym.make(env).unwrapped.pool.core.id  # type: ignore[attr-defined]


def in_a_vector(env: str, folder: Path) -> str:
    return gym.make_vec(env, num_envs=2).unwrapped.pool.core.id  # type: ignore[attr-defined]


def in_a_manifest(env: str, folder: Path) -> str:
    return swm.make_manifest(folder / "task.toml", env, episodes=1)["env"]


def in_a_plan(env: str, folder: Path) -> str:
    return swm.plan("cem:samples=4,elites=2,iterations=1,horizon=1,receding_horizon=1", env, budget=1, progress=False)["env"]


def in_a_benchmark(env: str, folder: Path) -> str:
    return swm.bench(env, seconds=0.01, progress=False)[0]["env"]


def in_an_image(env: str, folder: Path) -> str:
    return by_result(lambda name: swm.render(folder / "a.png", name, steps=0) and (folder / "a.png").read_bytes(), env)


def in_a_measurement(env: str, folder: Path) -> str:
    return by_result(lambda name: swm.measure(name, "gain=0.8", **SMALL)["open_loop_error"], env)


def in_a_replay(env: str, folder: Path) -> str:
    path = folder / "rooms.h5"
    with swm.World("swm_rs/TwoRoom-v2", 1, add_pixels=False, max_episode_steps=4) as world:
        world.set_policy("random")
        world.collect(path, episodes=1, seed=0, mode="overwrite", progress=False)
    return NEW if swm.replay(path, env_name=env, progress=False)["ok"] else PAPER


def in_training(env: str, folder: Path) -> str:
    if not _swm.HAS_TRAINING:
        pytest.skip("this build has no training")
    swm.train("sac", out=folder / "run", env=env, preset="small", steps=1, max_steps=4, progress=False)
    return json.loads((folder / "run" / "config.json").read_text())["env"]


def on_the_page(env: str, folder: Path) -> str:
    with Page(env=env, open_browser=False) as page:
        return unquote(page.url.rpartition("env=")[2])


def in_the_list(env: str, folder: Path) -> str:
    return swm.envs.info(env)["id"]


def by_result(made: Callable[[str], Any], env: str) -> str:
    """The id of the core that gives the same result."""
    found = made(env)
    [same] = [name for name in (PAPER, NEW) if made(name.replace("swm/", "swm_rs/")) == found]
    return same


DOORS = [
    *(in_world, in_gymnasium, in_a_vector, in_a_manifest, in_a_plan, in_a_benchmark, in_an_image, in_a_measurement, in_a_replay, in_training),
    *(on_the_page, in_the_list),
]


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_an_id_is_that_of_the_command_everywhere(door: Callable[[str, Path], str], tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def noted(env: str) -> list[str]:
        caplog.clear()
        (folder := tmp_path / env.replace("/", "-")).mkdir()
        assert door(env, folder) == env.replace("swm_rs/", "swm/")
        return [message for message in caplog.messages if "TwoRoom" in message]

    with caplog.at_level(logging.WARNING, logger=LOGGER):
        assert [noted(env) for env in (NEW, "swm_rs/TwoRoom-v2", "swm_rs/TwoRoom-v1")] == [[], [], []]
        [note] = noted(PAPER)
    assert note.startswith("swm/TwoRoom-v1 is the environment of the paper") and "is swm/TwoRoom-v2 here" in note


def test_the_environment_of_the_paper_is_noted_once_per_process(run_python: Run) -> None:
    done = run_python(
        "import logging; logging.basicConfig(format='NOTE %(message)s')\n"
        "import gymnasium, stable_worldmodel_rs as swm\n"
        "swm.World('swm/TwoRoom-v2', 1, add_pixels=False)\nprint('asked', flush=True)\n"
        "for _ in range(2): swm.World('swm/TwoRoom-v1', 1, add_pixels=False); gymnasium.make('swm/TwoRoom-v1'); swm.envs.info('swm/TwoRoom-v1')"
    )
    assert done.returncode == 0 and done.stderr.count("NOTE") == 1 and "swm/TwoRoom-v2" in done.stderr, done.stderr


def test_ids_for_files_are_noted_too_and_stay(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for door in (
        lambda: write(tmp_path / "a.h5", mode="overwrite", metadata={"env": PAPER}),
        lambda: swm.data.load_dataset(write(tmp_path / "b.h5"), env=PAPER),
    ):
        ids._note.cache_clear()
        caplog.clear()
        with caplog.at_level(logging.WARNING, logger=LOGGER):
            door()
        assert len([message for message in caplog.messages if PAPER in message]) == 1, caplog.messages
    assert swm.data.load_dataset(tmp_path / "a.h5").metadata["env"] == PAPER


def test_all_ids_are_listed_and_registered() -> None:
    core = set(ids.env_ids())
    assert core <= swm.envs.WORLDS and {PAPER, NEW, "swm/OGBMaze-v0"} <= swm.envs.WORLDS
    assert all(swm.envs.gym_ids()[name] == name for name in core)
    assert all(gym.spec(name).entry_point == "stable_worldmodel_rs.envs:Env" for name in swm.envs.gym_ids())
    with pytest.raises(gym.error.VersionNotFound):
        gym.make("swm/TwoRoom-v3")


def test_specs_that_were_saved_keep_their_environment() -> None:
    # As an earlier version of this package registered the id.
    spec = copy.deepcopy(gym.spec(PAPER))
    spec.kwargs = {"env_name": "swm_rs/TwoRoom-v2"}
    again = gym.envs.registration.EnvSpec.from_json(spec.to_json())
    assert gym.make(again).unwrapped.pool.core.id == NEW  # type: ignore[attr-defined]


@pytest.mark.parametrize("env", [PAPER, NEW])
def test_files_have_the_ids_of_the_core(env: str, tmp_path: Path) -> None:
    path = tmp_path / "rooms.h5"
    with swm.World(env, 1, image_shape=(16, 16), max_episode_steps=12) as world:
        world.set_policy("random")
        world.collect(path, episodes=2, seed=0, progress=False)
        assert swm.evaluate_from_dataset(world, swm.data.load_dataset(path), episodes=1, goal_offset=2, eval_budget=2)["episodes"] == 1
    assert swm.data.load_dataset(path).metadata["env"] == env
    assert swm.replay(path, progress=False)["ok"]
    made = swm.make_manifest(tmp_path / "task.toml", env, episodes=1, dataset=path, goal_offset=2, budget=2)
    assert swm.read_manifest(tmp_path / "task.toml") == made
    receipt = swm.evaluate(made, lambda infos: np.zeros((1, 2), np.float32), name="zero", references=[], num_envs=1, progress=False)
    assert receipt["manifest"]["env"] == env


def test_compat_has_the_references_ids(run_python: Run, tmp_path: Path) -> None:
    code = f"""{INSTALL}
import stable_worldmodel as swm, gymnasium, numpy, warnings
from pathlib import Path
warnings.simplefilter("ignore")
folder = Path({str(tmp_path)!r})
def made(env):
    world = swm.World(env, 1, add_pixels=False, max_episode_steps=3)
    world.set_policy("random")
    world.collect(folder / "a.h5", episodes=1, seed=0, mode="overwrite", check=True, progress=False)
    print(world.infos["env_name"][0][0], swm.data.load_dataset(folder / "a.h5").metadata["env"], gymnasium.make(env).unwrapped.pool.core.id)
    print(swm.make_manifest(folder / "task.toml", env, episodes=1, budget=2, overwrite=True)["env"], swm.envs.info(env)["id"])
    receipt = swm.evaluate(folder / "task.toml", lambda infos: numpy.zeros((1, 2), "float32"), name="zero", references=[], num_envs=1, progress=False)
    print(receipt["manifest"]["env"], swm.envs.gym_ids()[env], swm.replay(folder / "a.h5", progress=False)["ok"])
for env in ("swm/TwoRoom-v1", "swm/TwoRoom-v2", "swm_rs/TwoRoom-v1", "swm/PushT-v1"):
    made(env)
"""
    done = run_python(code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [word for env in (NEW, NEW, PAPER, "swm/PushT-v1") for word in [*[env] * 7, "True"]]
    assert "NOTE" not in done.stderr, done.stderr


@pytest.mark.parametrize("first", ["import gymnasium\n", ""])
def test_gymnasium_follows_compat(run_python: Run, first: str) -> None:
    code = f"""{first}{INSTALL}
import gymnasium, warnings
warnings.simplefilter("ignore")
def made():
    spec = gymnasium.spec("swm/TwoRoom-v1")
    # A process of a vector has the spec without `compat`.
    print(gymnasium.make(spec).unwrapped.pool.core.id, spec.kwargs["env_name"])
made()
ours.compat.uninstall()
made()
ours.compat.install()
made()
"""
    done = run_python(code)
    assert done.stdout.split() == [NEW, "swm_rs/TwoRoom-v2", PAPER, PAPER, NEW, "swm_rs/TwoRoom-v2"], done.stderr
    assert done.stderr.count("NOTE") == 1


def test_an_id_of_another_stays_under_compat(run_python: Run) -> None:
    code = f"""
import gymnasium
gymnasium.register(id="swm/TwoRoom-v1", entry_point="somewhere:Else")
{INSTALL}
print(gymnasium.spec("swm/TwoRoom-v1").entry_point)
ours.compat.uninstall()
print(gymnasium.spec("swm/TwoRoom-v1").entry_point)
"""
    assert run_python(code).stdout.split() == ["somewhere:Else"] * 2


def test_the_references_own_environment_is_recorded_with_the_id_here() -> None:
    class Theirs: ...

    def name(env: Any, spec: str) -> str:
        return foreign.name_of(SimpleNamespace(unwrapped=env, spec=SimpleNamespace(id=spec)))

    mine = Theirs()
    assert name(mine, PAPER) == PAPER
    Theirs.__module__ = "stable_worldmodel.envs.two_room.env"
    assert name(mine, PAPER) == NEW and name(mine, "swm/PushT-v1") == "swm/PushT-v1" and name(mine, "swm/Other-v0") == "swm/Other-v0"


@pytest.mark.parametrize(
    ("given", "env", "settings"),
    [
        ({}, "swm/OGBPointMaze-v0", {"mode": "task"}),
        ({"maze_env_type": "maze", "maze_type": "giant"}, "swm/OGBPointMaze-v0", {"mode": "task", "maze_type": "giant"}),
        ({"loco_env_type": "ant", "ob_type": "states"}, "swm/OGBAntMaze-v0", {"mode": "task"}),
        ({"loco_env_type": "humanoid", "terminate_at_goal": False}, "swm/OGBHumanoidMaze-v0", {"mode": "task", "terminate_at_goal": False}),
        ({"loco_env_type": "ant", "maze_env_type": "ball", "maze_type": "medium"}, "swm/OGBAntSoccer-v0", {"mode": "task", "maze_type": "medium"}),
        ({"loco_env_type": "ant", "reward_task_id": 3}, "swm/OGBAntMaze-v0", {"mode": "task", "task": 3}),
        ({"loco_env_type": "ant", "maze_env_type": "ball", "reward_task_id": 0}, "swm/OGBAntSoccer-v0", {"mode": "task", "task": 4}),
        ({"reward_task_id": 0}, "swm/OGBPointMaze-v0", {"mode": "task", "task": 1}),
        ({"mode": "data_collection", "camera": "top"}, "swm/OGBPointMaze-v0", {"mode": "data_collection", "camera": "top"}),
    ],
)
def test_ogb_maze_is_the_maze_of_its_settings(given: dict[str, Any], env: str, settings: dict[str, Any]) -> None:
    before = dict(given)
    assert maze_of(given) == (env, settings) and given == before


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"loco_env_type": "spider"}, "loco_env_type='spider' is not available; give 'point', 'ant' or 'humanoid'"),
        ({"maze_env_type": ["ball"]}, r"maze_env_type=\['ball'\] is not available; give 'maze' or 'ball'"),
        ({"maze_env_type": "ball"}, "maze_env_type='ball' is not available with loco_env_type='point'; give loco_env_type='ant'"),
        ({"ob_type": "pixels"}, r"ob_type='pixels' is not available; leave it out, .*image_shape=\(height, width\)"),
        ({"width": 64}, r"width= is not available; leave it out, .*image_shape=\(height, width\)"),
        ({"reward_task_id": 1, "task": 2}, "task and reward_task_id are the same setting; give one of them"),
    ],
)
def test_settings_that_ogb_maze_does_not_have_here_are_named(given: dict[str, Any], message: str) -> None:
    with pytest.raises(swm.EnvError, match=f"swm/OGBMaze-v0: {message}"):
        swm.World("swm/OGBMaze-v0", add_pixels=False, **given)


def test_ogb_maze_is_no_id_of_files(tmp_path: Path) -> None:
    with pytest.raises(swm.DataError, match="'swm/OGBMaze-v0', which is several environments here; give .*swm/OGBPointMaze-v0, .*swm/OGBAntSoccer-v0"):
        write(tmp_path / "a.h5", metadata={"env": "swm/OGBMaze-v0"})


@pytest.mark.parametrize("body", ["point", "ant"])
def test_ogb_maze_is_made_everywhere(body: str, ogbench: None, tmp_path: Path) -> None:
    env = maze_of({"loco_env_type": body})[0]
    spelled: dict[str, Any] = {"loco_env_type": body, "maze_env_type": "maze", "maze_type": "medium"}
    infos = []
    for name, settings in (("swm/OGBMaze-v0", spelled), (env, {"mode": "task", "maze_type": "medium"})):
        world = swm.World(name, 2, add_pixels=False, **settings)
        world.reset(seed=4)
        infos.append({key: np.array(value) for key, value in world.infos.items()})
        world.close()
    assert infos[0].keys() == infos[1].keys() and set(infos[0]["env_name"].ravel()) == {env} and (infos[0]["task_id"] >= 1).all()
    for key, value in infos[0].items():
        np.testing.assert_array_equal(value, infos[1][key])
    assert gym.make("swm/OGBMaze-v0", **spelled).unwrapped.pool.core.id == env  # type: ignore[attr-defined]
    assert gym.make_vec("swm/OGBMaze-v0", num_envs=2, **spelled).unwrapped.pool.core.id == env  # type: ignore[attr-defined]
    made = swm.make_manifest(tmp_path / "maze.toml", "swm/OGBMaze-v0", episodes=1, budget=2, **spelled)
    assert made["env"] == env and made["settings"] == {"mode": "task", "maze_type": "medium"}
    assert swm.envs.info("swm/OGBMaze-v0")["id"] == "swm/OGBPointMaze-v0"
