"""Arguments of the wrong kind: the error names the argument, what it was given, and what to give."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from stable_worldmodel_rs.planning import CEMSolver

LENGTH = 11


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "a.h5"
    with swm.data.HDF5Writer(path) as writer:
        for _ in range(3):
            writer.write_episode({"pixels": np.zeros((LENGTH, 8, 8, 3), np.uint8), "action": np.zeros((LENGTH, 2), np.float32)})
    return path


class Cost:
    array_api = "numpy"

    def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
        return candidates.sum((2, 3))


def opened(path: Path, **options: Any) -> Any:
    return swm.data.load_dataset(path, **options)


def batches(path: Path, **options: Any) -> Any:
    return next(iter(swm.data.Loader(path, **{"batch_size": 2, **options})))


WRONG: dict[str, tuple[Callable[[Path], Any], str]] = {
    "batch size as text": (lambda path: batches(path, batch_size="8"), "batch_size='8': give a whole number"),
    "batch size as a float": (lambda path: batches(path, batch_size=8.0), "batch_size=8.0: give a whole number"),
    "batch size of none": (lambda path: batches(path, batch_size=None), "batch_size=None: give a whole number"),
    "shuffle as text": (lambda path: batches(path, shuffle="no"), "shuffle='no' is a text; give True or False"),
    "seed as text": (lambda path: batches(path, seed="a"), "seed='a': give a whole number"),
    "keys as text": (lambda path: batches(path, keys="pixels"), r"keys='pixels' is a text; give a list: \['pixels'\]"),
    "side of images": (lambda path: batches(path, image=8), "image=8: give the height and width"),
    "shard of a number": (lambda path: batches(path, shard=1), r"shard=1: give \(rank, world size\)"),
    "list of transforms": (lambda path: batches(path, transform=[dict]), "transform is list; give a function of a batch"),
    "steps as text": (lambda path: opened(path, num_steps="4"), "num_steps='4': give a whole number from 1 on"),
    "half a step": (lambda path: opened(path, num_steps=1.5), "num_steps=1.5 must be a whole number, 1 or more"),
    "transforms by column": (lambda path: opened(path, transform={"pixels": abs}), "transform is dict; give a function of a clip"),
    "transform without return": (lambda path: opened(path, transform=lambda clip: None)[0], "transform= returned NoneType; .*end it with `return clip`"),
    "episodes as text": (lambda path: opened(path, episodes="0"), r"episodes='0' is a text; give a list of numbers"),
    "image of a side": (lambda path: opened(path, image=8), "image=8: give the height and width"),
    "clip by a column": (lambda path: opened(path)["pixels"], r"dataset\['pixels'\]: clips have whole numbers; a column is read by get_col_data"),
    "clip of a half": (lambda path: opened(path)[1.5], r"dataset\[1.5\]: clips have whole numbers"),
    "slice of clips": (lambda path: opened(path)[0:2], r"dataset\[slice\(0, 2, None\)\].*__getitems__\(\[0, 1, 2\]\)"),
    "dataset in the place of a path": (lambda path: swm.data.convert(opened(path), path), "in the place of a path; it is open already: its path is .*a.h5"),
    "path in the place of a dataset": (lambda path: swm.data.split(str(path), [0.5]), "split divides a dataset, not .*open it first"),  # type: ignore[arg-type]
    "parts as text": (lambda path: swm.data.split(opened(path), [0.5, "x"]), r"fractions=\[0.5, 'x'\]: give parts of 1 as numbers"),  # type: ignore[list-item]
    "scaler of a dataset": (lambda path: swm.data.ZScoreScaler().fit(opened(path)), "a scaler is fitted on an array .*get_col_data"),
    "scaler of none": (lambda _: swm.data.ZScoreScaler().fit(None), "a scaler is fitted on an array .*not on None"),
    "scaler of another dim": (
        lambda _: swm.data.ZScoreScaler().fit(np.random.default_rng(0).normal(size=(9, 2))).transform(np.zeros((3, 4))),
        r"ZScoreScaler was fitted on rows of 2 values, and is given \[3, 4\]; give \(…, 2\)",
    ),
    "environment of none": (lambda _: swm.World(None, num_envs=1), "World was given None; give the id of an environment"),  # type: ignore[arg-type]
    "environments as text": (lambda _: swm.World("swm/PushT-v1", num_envs="2", add_pixels=False), "num_envs='2'; give a whole number"),  # type: ignore[arg-type]
    "no environments": (lambda _: swm.World("swm/PushT-v1", num_envs=0, add_pixels=False), "num_envs"),
    "solver's seed": (lambda _: CEMSolver(Cost(), seed="a"), "seed='a': give a whole number"),  # type: ignore[arg-type]
    "solver's seed of many bits": (lambda _: CEMSolver(Cost(), seed=2**64), "seed=18446744073709551616: give a whole number from -9223372036854775808 to 9223372036854775807"),
    "solver's seed far below 0": (lambda _: CEMSolver(Cost(), seed=-(2**64)), "seed=-18446744073709551616: give -9223372036854775808 or more"),
    "seed of a split below 0": (lambda path: swm.data.split(opened(path), [0.5], seed=-1), "seed=-1: give 0 or more"),
    "seed of a split of many bits": (lambda path: swm.data.split(opened(path), [0.5], seed=2**64), "seed=18446744073709551616: give a whole number from 0 to"),
    "solver's batch size": (lambda _: CEMSolver(Cost(), batch_size="a"), "batch_size='a': give a whole number"),  # type: ignore[arg-type]
    "manifest of none": (lambda _: swm.evaluate(None, "random"), "the manifest is NoneType; give its file"),  # type: ignore[call-overload]
    "manifest as a dict": (lambda _: swm.evaluate({"env": "swm/PushT-v1"}, "random"), "the manifest is dict; give its file"),  # type: ignore[call-overload]
}


@pytest.mark.parametrize("what", WRONG)
def test_arguments_of_the_wrong_kind_are_named(what: str, dataset: Path) -> None:
    call, message = WRONG[what]
    with pytest.raises((TypeError, ValueError), match=message):
        call(dataset)


NO_NUMBERS: dict[str, tuple[str, Callable[[Path, Any], Any]]] = {
    "World": ("max_episode_steps", lambda _, value: world_with(_, max_episode_steps=value)),
    "World's frames": ("frame_skip", lambda _, value: world_with(_, frame_skip=value)),
    "World of gymnasium": ("max_episode_steps", lambda _, value: swm.World("CartPole-v1", add_pixels=False, max_episode_steps=value)),
    "evaluate": ("episodes", lambda _, value: evaluated(_, episodes=value)),
    "collect": ("episodes", lambda path, value: collected(path, episodes=value)),
    "collect to a total": ("total", lambda path, value: collected(path, episodes=0, total=value)),
    "steps of a buffer": ("max_steps", lambda _, value: swm.data.ReplayBuffer(value)),
    "budget": ("eval_budget", lambda path, value: from_rows(path, eval_budget=value)),
    "rows to choose": ("episodes", lambda path, value: from_rows(path, episodes=value)),
}


@pytest.mark.parametrize("what", NO_NUMBERS)
def test_no_whole_number_is_a_type_error_and_one_too_small_a_value_error(what: str, tmp_path: Path) -> None:
    name, call = NO_NUMBERS[what]
    path = tmp_path / "a.h5"
    collected(path.with_name("b.h5"), into=path, episodes=2)
    for wrong in ("2", 2.0, 2.5):
        with pytest.raises(TypeError, match=f"{name}={wrong!r}: give a whole number"):
            call(path, wrong)
    for wrong in (-3, 0):
        with pytest.raises(ValueError, match=f"{name}(=| must).*{wrong}"):
            call(path, wrong)


NO_PATHS: dict[str, tuple[str, Callable[[Path, Any], Any]]] = {
    "collect": ("path", lambda path, value: collected(path, into=value)),
    "video": ("video", lambda _, value: evaluated(_, video=value)),
    "receipt": ("out", lambda path, value: evaluated_on_a_manifest(path, out=value)),
    "sweep": ("out", lambda path, value: swept(path, value)),
    "manifest": ("the manifest", lambda _, value: swm.read_manifest(value)),
    "result": ("path", lambda _, value: evaluated(_).to_json(value)),
    "writer": ("path", lambda _, value: swm.data.HDF5Writer(value)),
    "convert": ("dest", lambda path, value: swm.data.convert(path, value, progress=False)),
    "merge": ("dest", lambda path, value: swm.data.merge([path, path], value, progress=False)),
    "split": ("out", lambda path, value: swm.data.split_files(path, value)),
    "tracker": ("folder", lambda _, value: swm.track.start(None, value)),
    "repository": ("folder", lambda path, value: swm.hub.save_dataset(path, value, license="mit")),
    "repository's dataset": ("source", lambda path, value: swm.hub.save_dataset(value, path, license="mit")),
    "upload": ("folder", lambda _, value: swm.hub.push_to_hub(value, "user/repo")),
    "viewer": ("path", lambda path, value: swm.data.to_rerun(opened(path), value)),
}


@pytest.mark.parametrize("what", NO_PATHS)
def test_no_path_is_a_type_error_that_names_the_argument(what: str, dataset: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    name, call = NO_PATHS[what]
    for wrong in (3, 3.5):
        with pytest.raises(TypeError, match=f"{name} is {type(wrong).__name__}; give "):
            call(dataset, wrong)
    assert not list(tmp_path.iterdir())


def test_no_columns_to_load_are_refused(dataset: Path) -> None:
    for none in ([], ()):
        with pytest.raises(ValueError, match=r"keys_to_load is empty; name columns.*or leave it out for all"):
            opened(dataset, keys_to_load=none)


REQUESTS: dict[str, Callable[[Path, int], Any]] = {
    "measure": lambda _, seed: swm.measure("swm/TwoRoom-v2", "constant", seed=seed, progress=False),
    "plan": lambda _, seed: swm.plan("cem:samples=8", "swm/TwoRoom-v2", seed=seed),
    "render": lambda path, seed: swm.render(path.with_name("a.png"), "swm/TwoRoom-v2", seed=seed),
    "make_manifest": lambda path, seed: swm.make_manifest(path.with_name("a.toml"), "swm/TwoRoom-v2", seed=seed),
}


@pytest.mark.parametrize("what", REQUESTS)
@pytest.mark.parametrize("seed", [2**64, -(2**64)])
def test_seeds_of_requests_have_64_bits(what: str, seed: int, tmp_path: Path) -> None:
    with pytest.raises((ValueError, swm.SwmError), match=f"seed={seed}: give a whole number from 0 to 18446744073709551615"):
        REQUESTS[what](tmp_path / "a", seed)


def numbers_of(function: Any) -> list[str]:
    """The arguments that take one whole number."""
    parameters = inspect.signature(function, eval_str=False).parameters.values()
    return [one.name for one in parameters if str(one.annotation).removeprefix("<class '").removesuffix("'>").split(" | ")[0] == "int"]


def world_with(_: Path, **options: Any) -> Any:
    given = {"num_envs": 1, "add_pixels": False, "threads": 1, **options}
    return swm.World("swm/PushT-v1", **given)


def evaluated(_: Path, **options: Any) -> Any:
    world = world_with(_, max_episode_steps=2)
    world.set_policy("random")
    return world.evaluate(**{"episodes": 1, "progress": False, **options})


def collected(path: Path, **options: Any) -> Any:
    world = world_with(path, max_episode_steps=2)
    world.set_policy("random")
    into = options.pop("into", path.with_name("more.h5"))
    return world.collect(into, **{"episodes": 1, "progress": False, **options})


def from_rows(path: Path, **options: Any) -> Any:
    world = world_with(path, max_episode_steps=2)
    world.set_policy("random")
    return swm.evaluate_from_dataset(world, path, **{"episodes": 1, "goal_offset": 1, "eval_budget": 1, **options})


def swept(path: Path, out: Any) -> Any:
    manifest_of(path)
    return swm.sweep(path.with_name("task.toml"), "random", ["agent.color"], out=out, progress=False)


def manifest_of(path: Path, **options: Any) -> Any:
    return swm.make_manifest(path.with_name("task.toml"), "swm/PushT-v1", **{"episodes": 1, "budget": 2, "overwrite": True, **options})


def evaluated_on_a_manifest(path: Path, **options: Any) -> Any:
    manifest_of(path)
    return swm.evaluate(path.with_name("task.toml"), "random", **{"references": [], "progress": False, **options})


EXTREME: dict[str, tuple[Callable[..., Any], Any]] = {
    "World": (world_with, swm.World.__init__),
    "World.evaluate": (evaluated, swm.World.evaluate),
    "World.collect": (collected, swm.World.collect),
    "World.reset": (lambda path, **options: world_with(path).reset(**options), swm.World.reset),
    "make_manifest": (manifest_of, swm.make_manifest),
    "evaluate": (evaluated_on_a_manifest, swm.evaluate),
    "load_dataset": (opened, swm.data.Dataset.__init__),
    "Loader": (batches, swm.data.Loader.__init__),
    "CEMSolver": (lambda _, **options: CEMSolver(Cost(), **options), CEMSolver.__init__),
    "NativePolicy": (lambda _, **options: swm.NativePolicy("random", **options), swm.NativePolicy.__init__),
}


@pytest.mark.parametrize("what", EXTREME)
def test_whole_numbers_out_of_range_are_named(what: str, dataset: Path) -> None:
    call, function = EXTREME[what]
    names = numbers_of(function)
    assert names or what == "World.reset", function
    for name in names:
        # Numbers of environments that a machine could make are not tried.
        for value in (-1, 1 << 64, 1 << 200):
            try:
                call(dataset, **{name: value})
            except OverflowError as error:
                pytest.fail(f"{what}({name}={value}): {error}")
            except Exception as error:
                # Solvers call their settings otherwise.
                assert name.split("_")[-1] in str(error) or what == "CEMSolver", f"{what}({name}={value}): {error}"


def test_whole_numbers_of_numpy_are_whole(dataset: Path) -> None:
    assert batches(dataset, batch_size=np.int64(2), seed=np.int32(3))["action"].shape[0] == 2
    assert opened(dataset, num_steps=np.int64(2))[np.int64(1)]["action"].shape[0] == 2
    assert CEMSolver(Cost(), batch_size=np.int64(2), seed=-3).batch_size == 2
    assert swm.World("swm/PushT-v1", num_envs=np.int64(2), add_pixels=False, threads=1).num_envs == 2


def test_a_step_takes_what_policies_return() -> None:
    world = swm.World("swm/PushT-v1", num_envs=2, add_pixels=False, threads=1)
    world.reset(seed=0)
    world.step([[0.0, 0.0], [0.0, 0.0]])
    with pytest.raises(swm.PolicyError, match=r"World.step was given a list .*; give actions of shape \(2, 2\), one row per environment"):
        world.step([[0.0, 0.0], [0.0]])
    with pytest.raises(swm.PolicyError, match="World.step was given 'left'; give actions"):
        world.step("left")  # type: ignore[arg-type]
    torch = pytest.importorskip("torch")
    world.step(torch.zeros(2, 2, dtype=torch.bfloat16, requires_grad=True))


def test_devices_and_models_are_named() -> None:
    torch = pytest.importorskip("torch")
    for wrong in (None, torch.nn.Linear(1, 1)):
        with pytest.raises(TypeError, match="the checkpoint is .*; give its file, its folder"):
            swm.load_pretrained(wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="device='gpu': torch has no device of that name"):
        swm.load_pretrained("model", device="gpu")
    if not torch.cuda.is_available():
        with pytest.raises(ValueError, match="device='cuda': torch .* finds no such device here"):
            swm.load_pretrained("model", device="cuda")
    with pytest.raises(TypeError, match=r"the model is OrderedDict; give the torch module itself, not its state_dict\(\)"):
        swm.save_pretrained(torch.nn.Linear(1, 1).state_dict(), "folder", {"_target_": "stable_worldmodel.wm.LeWM"})
