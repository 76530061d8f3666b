"""What a newcomer gets wrong: messages name the object, the reason and the fix in words of Python."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm

# A command of the program, or an option of one.
COMMAND = re.compile(r"`swm [a-z]|(?<![\w-])--[a-z]")


def world() -> swm.World:
    made = swm.World("swm/PushT-v1", num_envs=1, add_pixels=False, threads=1)
    made.set_policy("random")
    return made


def unknown_policy(_: Path) -> None:
    world().set_policy("wek")


def unknown_factor(_: Path) -> None:
    world().reset(seed=0, options={"variation": ["agent.colr"]})


def unknown_environment(_: Path) -> None:
    swm.World("swm_rs/PushTT-v1", add_pixels=False)


def unknown_solver(_: Path) -> None:
    _swm.Solver("cen", "{}")


def no_manifest(folder: Path) -> None:
    (folder / "task.toml").write_text("no manifest [")
    swm.read_manifest(folder / "task.toml")


def no_receipt(folder: Path) -> None:
    (folder / "receipt.json").write_text("{}")
    swm.read_receipt(folder)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (unknown_policy, ["`wek`", "did you mean `weak`?", '`swm.envs.info("swm_rs/PushT-v1")` lists them']),
        (unknown_factor, ["`agent.colr`", "did you mean `agent.color`?", "`variation_space` of the environment"]),
        (unknown_environment, ["`swm/PushTT-v1`", "did you mean `swm/PushT-v1`?", "`swm.envs.WORLDS` lists them"]),
        (unknown_solver, ["`cen`", "did you mean `cem`?", "`swm-rs solvers` lists them"]),
        (no_manifest, ["task.toml", "is no manifest, which is TOML"]),
        (no_receipt, ["receipt.json", "an evaluation on a manifest writes one"]),
    ],
)
def test_messages_speak_python(call: Callable[[Path], None], words: list[str], tmp_path: Path) -> None:
    with pytest.raises(Exception) as caught:  # noqa: PT011  which one is said by the words
        call(tmp_path)
    message = str(caught.value)
    assert not [word for word in words if word not in message], message
    assert not COMMAND.search(message), message


def test_a_run_that_is_not_there_is_said_or_what_the_build_lacks() -> None:
    with pytest.raises(swm.SwmError) as caught:
        world().set_policy("mpc:runs/lewm")
    said = str(caught.value)
    if _swm.HAS_TRAINING:
        assert "run runs/lewm: there is no such folder; `swm-rs train` makes a run" in said
    else:
        assert "which every wheel has; install one" in said
        assert "`cargo xtask wheel`" in said and "cargo install" not in said


def test_a_setting_that_is_an_argument_is_offered_once() -> None:
    import gymnasium

    with pytest.raises(swm.EnvError) as caught:
        gymnasium.make("swm/PushT-v1", rendr="fast")
    assert str(caught.value).count("did you mean") == 1 and "`render`" in str(caught.value)
    with pytest.raises(swm.EnvError, match=r"did you mean max_episode_steps=\?"):
        swm.World("swm/PushT-v1", add_pixels=False, max_episode_step=3)


def test_wrong_names_are_said_before_what_is_missing() -> None:
    import gymnasium

    for name, meant in (("swm/PushTT-v1", "swm/PushT-v1"), ("PushT", "swm/PushT-v1"), ("PushT-v1", "swm/PushT-v1"), ("swm_rs/TwoRom-v2", "swm/TwoRoom-v2")):
        with pytest.raises((gymnasium.error.UnregisteredEnv, swm.EnvError), match=f"did you mean ['`]{meant}"):
            swm.World(name)
    for name, meant in (("PushT", "swm/PushT-v1"), ("swm/TwoRom-v1", "swm/TwoRoom-v2")):
        with pytest.raises(gymnasium.error.NameNotFound, match=f"did you mean '{meant}'"):
            swm.envs.info(name)
    for name in ("swm/PushT-v1", "CartPole-v1"):
        with pytest.raises((swm.EnvError, TypeError), match=r"did you mean image_shape=\?"):
            swm.World(name, image_size=(64, 64))  # type: ignore[arg-type]
        with pytest.raises((swm.EnvError, TypeError), match="nonsense"):
            swm.World(name, nonsense=1)


def test_ids_of_this_package_have_a_version(tmp_path: Path) -> None:
    for name, meant in (("swm/PushT", "swm/PushT-v1"), ("swm/TwoRoom", "swm/TwoRoom-v2"), ("swm_rs/TwoRoom", "swm_rs/TwoRoom-v2")):
        said = f"'{name}' names no version; give '{meant}'"
        with pytest.raises(swm.EnvError, match=said):
            swm.World(name, image_shape=(64, 64))
        with pytest.raises(swm.EnvError, match=said):
            swm.make_manifest(tmp_path / "a.toml", name)
        with pytest.raises(swm.EnvError, match=said):
            swm.envs.info(name)


@pytest.mark.parametrize("wrong", [64, (64,), (64, 64, 3), (6.4, 6.4), "64"])
def test_the_shape_of_images_is_named(wrong: object) -> None:
    import gymnasium

    said = r"image_shape=.*give the height and width of the images, such as image_shape=\(64, 64\)"
    with pytest.raises(TypeError, match=said):
        gymnasium.make("swm/PushT-v1", image_shape=wrong)
    with pytest.raises(TypeError, match=said):
        swm.World("swm/PushT-v1", image_shape=wrong)
    with pytest.raises(TypeError, match=said):
        swm.World("CartPole-v1", image_shape=wrong)
    with pytest.raises(TypeError, match=said):
        swm.make_manifest("never.toml", "swm/PushT-v1", image_shape=wrong)


def test_a_policy_without_actions_is_named() -> None:
    def forgets(infos: dict[str, object]) -> None:
        pass

    said = r"the policy `forgets` returned None; it must return actions of shape \(1, 2\)"
    native = swm.World("swm/PushT-v1", add_pixels=False, threads=1)
    native.set_policy(forgets)
    with pytest.raises(swm.PolicyError, match=said):
        native.evaluate(episodes=1, seed=0)
    native.reset(seed=0)
    with pytest.raises(swm.PolicyError, match=said):
        native.step()
    python = swm.World("MountainCarContinuous-v0", add_pixels=False)
    python.set_policy(forgets)
    with pytest.raises(swm.PolicyError, match=said.replace("1, 2", "1, 1")):
        python.evaluate(episodes=1, seed=0)


@pytest.mark.skipif(sys.version_info < (3, 11), reason="errors have notes from Python 3.11 on")
@pytest.mark.parametrize("name", ["swm/PushT-v1", "MountainCarContinuous-v0"])
def test_an_error_within_a_policy_has_a_note_of_what_it_was_given(name: str) -> None:
    def mine(infos: dict[str, object]) -> None:
        raise RuntimeError("mine")

    made = swm.World(name, 2, add_pixels=False, threads=1) if name.startswith("swm") else swm.World(name, 2, add_pixels=False)
    made.set_policy(mine)
    made.reset(seed=0)
    for call in (made.step, lambda: made.evaluate(episodes=1, seed=0), lambda: made.collect(writer=swm.data.ReplayBuffer(9), episodes=1, seed=0, progress=False)):
        with pytest.raises(RuntimeError, match="mine") as caught:
            call()
        assert str(caught.value) == "mine"
        (note,) = caught.value.__notes__
        assert note.startswith("the policy `mine` was given the infos ") and "reward [2, 1] float" in note


@pytest.mark.parametrize("wrong", [[3], 3, ["agent.color", None]])
def test_factors_that_are_no_names_are_named(wrong: object) -> None:
    import gymnasium

    said = f"variation={re.escape(repr(wrong))}: .* is no name; give names of factors"
    options: dict[str, object] = {"variation": wrong}
    made = world()
    for call in (lambda: made.reset(options=options), lambda: made.evaluate(episodes=1, options=options), lambda: made.evaluate(episodes=1, options=[options])):
        with pytest.raises(TypeError, match=said):
            call()
    with pytest.raises(TypeError, match=said):
        gymnasium.make("swm/PushT-v1").reset(options=options)


def test_names_of_optional_packages_are_those_of_pip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ImportError, match="`pip install huggingface_hub`"):
        swm.data.download("user/repo")


@pytest.mark.parametrize("seed", [1.5, "1", [0.5], -1])
def test_a_seed_that_is_none_is_named(seed: object) -> None:
    made = world()
    for call in (made.reset, lambda seed: made.evaluate(episodes=1, seed=seed)):
        with pytest.raises(swm.SwmError if seed == -1 else TypeError, match="seed=.*: give a whole number from 0 on, such as seed=8|seed=-1: give 0 or more"):
            call(seed=seed)  # type: ignore[arg-type]
    with pytest.raises(swm.SwmError if seed == -1 else TypeError, match="whole number from 0 on|seed=-1: give 0 or more"):
        swm.NativePolicy("random", seed=seed)  # type: ignore[arg-type]


def test_seeds_of_numpy_are_seeds() -> None:
    made = world()
    made.reset(seed=np.int64(3))
    first = made.infos["state"].copy()
    made.reset(seed=3)
    assert np.array_equal(first, made.infos["state"])
    made.reset(seed=np.array([7]))
    assert made.envs.seeds.tolist() == [7]


def test_a_reference_policy_is_a_policy_by_its_name() -> None:
    results = []
    for name in ("no-op", "no_op", "constant"):
        made = world()
        made.set_policy(name)
        results.append(made.evaluate(episodes=2, seed=0).plain() | {"wall_time_s": 0})
    assert results[0] == results[1] == results[2]


def test_metadata_of_a_writer_may_leave_out_what_is_not_known(tmp_path: Path) -> None:
    def write(**metadata: object) -> None:
        with swm.data.HDF5Writer(tmp_path / "a.h5", mode="overwrite", metadata=metadata) as writer:
            writer.write_episode({"x": np.zeros((3, 2), np.float32)})

    write(env="mine/Env-v0", seed=3)
    runs = swm.data.load_dataset(tmp_path / "a.h5").metadata
    recorded = runs[-1][1] if isinstance(runs, list) else runs
    assert (recorded["env"], recorded["seed"], recorded["policy"], recorded["from_recorded_rows"]) == ("mine/Env-v0", 3, "unknown", True)
    for wrong, message in [
        ({"enw": "a"}, "there is no `enw`.*did you mean `env`.*rows_per_second"),
        ({"seed": "three"}, "metadata: `seed`"),
        ({"frame_skip": -1}, "metadata: `frame_skip`"),
    ]:
        with pytest.raises(swm.DataError, match=message):
            write(**wrong)


def test_a_rollout_without_a_result_is_named() -> None:
    torch = pytest.importorskip("torch")
    from stable_worldmodel_rs.planning import GoalMSE, ShootingCostEvaluator

    class Model(torch.nn.Module):  # type: ignore[misc,name-defined]
        def __init__(self, result: object) -> None:
            super().__init__()
            self.result = result

        def rollout(self, info: dict[str, object], candidates: object) -> object:
            return info if self.result == "info" else self.result

        def encode(self, info: object) -> object:
            return self.result

    info = {"pixels": torch.zeros(1, 2, 1, 3), "goal": torch.zeros(1, 2, 1, 3)}
    for result, message in [
        (None, "Model.rollout returned NoneType; it must return the dict"),
        ("info", "the objective reads `predicted_emb`, and the rollout has pixels.*GoalMSE\\(pred_key=…\\)"),
    ]:
        cost = ShootingCostEvaluator(Model(result), GoalMSE(), encode_goal=None)
        with pytest.raises((TypeError, ValueError), match=message):
            cost.get_cost(dict(info), torch.zeros(1, 2, 3, 2))
    for result, told in [(None, "NoneType"), ({"embedding": 1}, "embedding")]:
        with pytest.raises(TypeError, match=f"Model.encode returned {told}; it must return a dict with the embedding as `emb`"):
            ShootingCostEvaluator(Model(result), GoalMSE()).get_cost(dict(info), torch.zeros(1, 2, 3, 2))
