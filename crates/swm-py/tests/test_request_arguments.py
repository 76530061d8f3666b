"""What is given to requests in place of text and numbers: arrays, tensors, paths, open datasets, single names, NaN. Errors name the argument."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from data_makers import write

ROOM = "swm/TwoRoom-v2"
SMALL: dict[str, Any] = {"episodes": 2, "rows": 6, "horizon": 2, "plans": 2, "progress": False}
PLANNER = "cem:samples=4,elites=2,iterations=1,horizon=1,receding_horizon=1"


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    return write(tmp_path / "toy.h5", lengths=(10, 7, 12))


def measure(**given: Any) -> dict[str, Any]:
    return swm.measure(ROOM, **{**SMALL, **given})


def plan(**given: Any) -> dict[str, Any]:
    return swm.plan(PLANNER, ROOM, budget=1, progress=False, **given)


def test_a_single_name_is_a_list_of_one(tmp_path: Path) -> None:
    assert measure(probe="state")["probes"] == measure(probe=["state"])["probes"]
    assert measure(violation="teleport")["violations"] == measure()["violations"]
    assert len(plan(variation="agent.color")["episodes"]) == 1
    swm.render(tmp_path / "one.png", ROOM, steps=0, variation="all")
    swm.render(tmp_path / "list.png", ROOM, steps=0, variation=["all"])
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "list.png").read_bytes()
    one = swm.make_manifest(tmp_path / "one.toml", ROOM, episodes=2, variation="agent.color")
    assert one["pairs"] == swm.make_manifest(tmp_path / "list.toml", ROOM, episodes=2, variation=["agent.color"])["pairs"]


def test_numbers_of_numpy_and_torch_are_numbers(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    assert measure(episodes=np.int64(2))["ranking"] == measure(episodes=torch.tensor(2))["ranking"]
    color = torch.tensor([255, 0, 0], dtype=torch.uint8)
    swm.render(tmp_path / "tensor.png", ROOM, steps=0, variation_values={"agent.color": color})
    swm.render(tmp_path / "list.png", ROOM, steps=0, variation_values={"agent.color": [255, 0, 0]})
    assert (tmp_path / "tensor.png").read_bytes() == (tmp_path / "list.png").read_bytes()


def test_what_is_no_text_and_no_number_is_named_with_its_argument(toy: Path, tmp_path: Path) -> None:
    dataset, solver = swm.data.load_dataset(toy), swm.MpcPolicy("cem:samples=4")
    wrong: list[tuple[Any, tuple[Any, ...], dict[str, Any], str]] = [
        (swm.measure, (ROOM, object()), SMALL, "model is object; give the name of one that can be measured: 'lewm:RUN'"),
        (swm.measure, (ROOM,), {**SMALL, "dataset": dataset}, f"dataset is HDF5Dataset; give its path, {str(toy)!r}"),
        (swm.measure, (solver,), SMALL, "env_name is MpcPolicy; give the id"),
        (swm.make_manifest, (tmp_path / "task.toml", None), {}, "env_name is NoneType; give the id"),
        (swm.bench, (solver,), {"progress": False}, "env_name is MpcPolicy; give the id"),
        (swm.plan, (solver, ROOM), {"progress": False}, "policy is MpcPolicy"),
        (swm.render, (tmp_path / "a.png", ROOM, print), {}, "policy is builtin_function_or_method"),
        (swm.train, ("lewm", dataset, tmp_path / "run"), {"preset": "small"}, "dataset is HDF5Dataset"),
        (swm.train, ("lewm", toy, tmp_path / "run"), {"settings": ["optim.lr=1"]}, "settings is list; give a dict"),
        (swm.train, ("lewm", toy, tmp_path / "run"), {"settings": {"optim.lr": object()}}, "settings['optim.lr'] is object"),
        (swm.reproduce, (None,), {}, "name is NoneType"),
        (swm.data.verify, (dataset,), {}, "source is HDF5Dataset"),
        (swm.data.convert, (toy, tmp_path / "b.mcap"), {"format": "mcap"}, "give dest_format='mcap'"),
        (swm.data.convert, (toy, tmp_path / "b.mcap"), {"overwrite": True}, "give mode='overwrite'"),
        (swm.data.split, (dataset, 0.8), {}, "give one for each part"),
        (dataset.subset, ([0.5],), {}, "episodes=0.5: give a whole number"),
        (swm.data.Loader(dataset, batch_size=2).__getitem__, (0,), {}, "a Loader makes batches itself"),
    ]
    for function, arguments, more, words in wrong:
        with pytest.raises(TypeError) as caught:
            function(*arguments, **more)
        assert words in str(caught.value), str(caught.value)


def test_evaluations_and_bundles_take_numbers_of_numpy(tmp_path: Path) -> None:
    task = tmp_path / "task.toml"
    swm.make_manifest(task, ROOM, episodes=np.int64(2), budget=np.int32(3))  # pyright: ignore[reportArgumentType]
    more: dict[str, Any] = {"num_envs": np.int64(2), "threads": np.int64(1)}
    swm.evaluate(task, "random", tmp_path / "result", references=["no_op"], progress=False, **more)
    swm.sweep(task, "random", factors=["agent.radius"], values="grid", points=np.int64(2), progress=False)  # pyright: ignore[reportArgumentType]
    reported: Any = np.float32(50)
    assert swm.bundle(tmp_path / "result", tmp_path / "bundle", reported=reported, source="a paper")["files"]
    with pytest.raises(ValueError, match="reported=nan"):
        swm.bundle(tmp_path / "result", tmp_path / "other", reported=float("nan"), source="a paper")
    with pytest.raises(TypeError, match="result is Receipt; give the folder `out` of evaluate"):
        swm.bundle(swm.read_receipt(tmp_path / "result"), tmp_path / "other")  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="source is object; give the folder of a model"):
        swm.hub.save_model(object(), tmp_path / "other", license="mit")  # pyright: ignore[reportArgumentType]


def test_numbers_that_are_not_finite_are_named_with_their_argument(toy: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"settings\['optim.lr'\]=nan"):
        swm.train("lewm", toy, tmp_path / "run", settings={"optim": {"lr": np.nan}}, progress=False)
    with pytest.raises(ValueError, match=r"variation_values\['agent.radius'\]=inf"):
        plan(variation_values={"agent.radius": float("inf")})
    with pytest.raises(ValueError, match="held_out=nan"):
        swm.make_manifest(tmp_path / "task.toml", ROOM, held_out=np.nan)


def test_a_recipe_takes_numbers_of_numpy() -> None:
    if swm.recipes():
        assert swm.reproduce("lewm-pusht", pairs=np.int64(3), check_only=True)["needs"]  # pyright: ignore[reportArgumentType]


def test_a_part_without_an_episode_is_noted(toy: Path, caplog: pytest.LogCaptureFixture) -> None:
    training, rest = swm.data.split(swm.data.load_dataset(toy), [0.99, 0.01])
    assert len(training) and not len(rest) and "the part of 0.01 has none of the 3 episodes" in caplog.text


def test_a_loader_takes_columns_and_states_of_loaders_alone(toy: Path) -> None:
    dataset = swm.data.load_dataset(toy)
    with pytest.raises(ValueError, match="keys is empty"):
        swm.data.Loader(dataset, batch_size=2, keys=[])
    for state in ({}, None, {"position": 3}):
        with pytest.raises(ValueError, match="give what state_dict"):
            swm.data.Loader(dataset, batch_size=2).load_state_dict(state)  # pyright: ignore[reportArgumentType]


def test_datasets_of_requests_are_found_by_name_as_those_that_are_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STABLEWM_HOME", str(tmp_path / "home"))
    world = swm.World(ROOM, num_envs=1, max_episode_steps=12, add_pixels=False)
    world.set_policy(swm.NativePolicy("random"))
    world.collect(tmp_path / "home" / "datasets" / "room.h5", episodes=4, seed=0, progress=False)
    monkeypatch.chdir(tmp_path)
    assert swm.replay("room.h5", progress=False)["ok"]
    assert measure(dataset="room.h5", rows=4)["stride"] == 1
    assert len(swm.make_manifest("task.toml", ROOM, dataset="room.h5", episodes=2, goal_offset=3)["pairs"]) == 2
    missing: list[tuple[Any, tuple[Any, ...], dict[str, Any]]] = [
        (swm.replay, ("rom.h5",), {"progress": False}),
        (swm.measure, (ROOM,), {**SMALL, "dataset": "rom.h5"}),
        (swm.make_manifest, ("other.toml", ROOM), {"dataset": "rom.h5"}),
        (swm.train, ("lewm", "rom.h5", "run"), {"preset": "small"}),
    ]
    for function, arguments, more in missing:
        with pytest.raises(FileNotFoundError, match=r"'rom\.h5' is neither in .*datasets nor a path"):
            function(*arguments, **more)
    for path in ("./room.h5", "~/no_room.h5"):
        with pytest.raises(FileNotFoundError, match=f"^'{path}' does not exist"):
            swm.replay(path, progress=False)


def test_steps_per_second_are_measured_and_refusals_name_arguments() -> None:
    found = swm.bench(ROOM, seconds=0.01, progress=False, render="fast")
    assert len(found) in (10, 15) and all(one["steps_per_second"] > 0 for one in found)
    assert {one["image"] for one in found} >= {"", "64x64 exact", "224x224 fast"}
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"seconds": 0}, "seconds=0.0: use a number above 0"),
        ({"seconds": float("nan")}, "seconds"),
        ({"policy": "nobody"}, "nobody"),
        ({"render": "best"}, "render"),
    ]
    for given, words in wrong:
        with pytest.raises((swm.SwmError, ValueError)) as caught:
            swm.bench(ROOM, progress=False, **given)
        assert words in str(caught.value), str(caught.value)
