"""Evaluations: online, from rows of a dataset, and on manifests; equal to the command's, bit for bit."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stable_worldmodel_rs as swm


def command(*arguments: str) -> Any:
    """What the command prints as JSON."""
    done = subprocess.run(
        [sys.executable, "-m", "stable_worldmodel_rs", *arguments, "--json"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def make(num_envs: int = 3, **kwargs: object) -> swm.World:
    return swm.World("swm/PushT-v1", num_envs, image_shape=(32, 32), threads=1, **kwargs)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "pusht.h5"
    world = make()
    world.set_policy("weak")
    world.collect(path, episodes=4, seed=0, progress=False)
    return path


def test_results_have_the_references_keys() -> None:
    world = make()
    world.set_policy("expert")
    result = world.evaluate(episodes=4, seed=42)
    assert isinstance(result, dict)
    assert result["episode_successes"].shape == (4,) and result["episode_successes"].dtype == np.bool_
    assert result["seeds"].shape == (4,) and result["seeds"].dtype == np.int64
    assert result["success_rate"] == 100.0 * result["episode_successes"].mean()
    low, high = result["interval"]
    assert low <= result["success_rate"] <= high and result["episodes"] == 4
    assert result["setup"]["env"] == "swm/PushT-v1" and result["setup"]["policy"].startswith("expert")


class Watcher:
    """Acts never, and keeps the first infos."""

    def __init__(self) -> None:
        self.seen: dict[str, np.ndarray] = {}

    def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
        self.seen = self.seen or {name: infos[name].copy() for name in ("goal", "pixels", "goal_state")}
        return np.zeros((len(infos["pixels"]), 2), np.float32)


def test_goals_from_a_dataset_are_the_recorded_frames(recorded: Path, caplog: pytest.LogCaptureFixture) -> None:
    dataset = swm.data.load_dataset(str(recorded))
    rows, offset = [(0, 2), (1, 3), (3, 7)], 5
    chunks = dataset.load_chunk(*np.array([(episode, row, row + offset + 1) for episode, row in rows]).T)
    frames = [np.moveaxis(np.asarray(chunk["pixels"]), 1, -1) for chunk in chunks]
    for side, is_recorded in ((32, True), (48, False)):
        world, watcher = swm.World("swm/PushT-v1", 3, image_shape=(side, side), threads=1), Watcher()
        world.set_policy(watcher)
        caplog.clear()
        swm.evaluate_from_dataset(
            world, dataset, [episode for episode, _ in rows], [row for _, row in rows], eval_budget=2, goal_offset=offset
        )
        notes = [record.getMessage() for record in caplog.records if "images of goals" in record.getMessage()]
        if is_recorded:
            assert not notes
            np.testing.assert_array_equal(watcher.seen["goal"][:, 0], [frame[-1] for frame in frames])
            np.testing.assert_array_equal(watcher.seen["pixels"][:, 0], [frame[0] for frame in frames])
        else:
            assert notes == [
                "images of goals are rendered from the recorded states, as the dataset's images are 32x32, this World's are 48x48"
            ]


def test_a_given_goal_image_has_the_size_of_the_others() -> None:
    frame = np.full((32, 32, 3), 7, np.uint8)
    world = make(1)
    world.reset(seed=0, options={"goal_image": frame})
    np.testing.assert_array_equal(world.infos["goal"][0, 0], frame)
    with pytest.raises(swm.EnvError, match=r"`goal_image` is uint8 \[8, 8, 3\]; it takes uint8 \[32, 32, 3\]"):
        world.reset(seed=0, options={"goal_image": frame[:8, :8]})
    with pytest.raises(swm.EnvError, match="it has no images of goals"):
        swm.World("swm/PushT-v1", 1, add_pixels=False).reset(seed=0, options={"goal_image": frame})


def test_the_command_notes_goals_that_it_renders(recorded: Path) -> None:
    ask = ("eval", "swm/PushT-v1", "--policy", "random", "--dataset", str(recorded))
    ask += ("--episodes", "2", "--goal-offset", "5", "--budget", "2")
    assert command(*ask, "--image-size", "32x32")["protocol"]["goal_images"] == {"kind": "recorded"}
    reason = "factors are not those of the recorded episodes"
    found = command(*ask, "--image-size", "32x32", "--vary", "agent.color")
    assert found["protocol"]["goal_images"] == {"kind": "rendered", "reason": reason}
    assert "goal_images" not in command(*ask)["protocol"]


@pytest.mark.parametrize("shape", [(2, 3), (6,), (3, 3), (3,), (1, 2)])
def test_actions_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    world = make(3)
    world.set_policy(lambda infos: np.zeros(shape, np.float32))
    with pytest.raises(swm.SwmError, match=r"actions must be numbers of shape \[3, 2\]|it must return actions of shape \(3, 2\)"):
        world.evaluate(episodes=3, seed=0)


@pytest.mark.parametrize("episodes", [0, -1])
def test_no_episodes_are_refused(episodes: int) -> None:
    world = swm.World("swm/TwoRoom-v2", num_envs=1, add_pixels=False)
    world.set_policy("expert")
    with pytest.raises(ValueError, match=f"episodes={episodes}: give 1 or more"):
        world.evaluate(episodes=episodes, progress=False)


def test_an_evaluation_is_the_commands() -> None:
    world = make(max_episode_steps=30)
    world.set_policy("weak")
    ours = world.evaluate(episodes=5, seed=3, options={"variation": ["agent"]})
    theirs = command(
        *("eval", "swm/PushT-v1", "--policy", "weak", "--episodes", "5", "--seed", "3", "--budget", "30", "--vary", "agent")
    )
    assert ours["episode_returns"].tolist() == theirs["episode_returns"]
    assert ours["seeds"].tolist() == theirs["seeds"]
    assert list(ours["interval"]) == theirs["ci95"]


def test_an_evaluation_from_a_dataset_is_the_commands(recorded: Path) -> None:
    world = make(2)
    world.set_policy("weak")
    dataset = swm.data.load_dataset(str(recorded))
    ours = swm.evaluate_from_dataset(world, dataset, episodes=6, goal_offset=10, eval_budget=20, seed=4)
    theirs = command(
        *("eval", "swm/PushT-v1", "--policy", "weak", "--dataset", str(recorded), "--episodes", "6"),
        *("--goal-offset", "10", "--budget", "20", "--seed", "4"),
    )
    assert ours["episode_returns"].tolist() == theirs["episode_returns"]
    assert ours["episode_successes"].tolist() == theirs["episode_successes"]
    assert ours["seeds"].tolist() == theirs["seeds"]
    # The time limit of the World is its own again.
    assert max(world.evaluate(episodes=1, seed=0)["episode_lengths"]) == 100


def test_chosen_rows_are_starts_and_goals(recorded: Path) -> None:
    class Looks:
        first: dict[str, np.ndarray] | None = None

        def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
            if self.first is None:
                self.first = {name: infos[name].copy() for name in ("state", "goal_state", "goal")}
            return np.zeros((2, 2))

    dataset = swm.data.load_dataset(str(recorded))
    world, policy = make(2), Looks()
    world.set_policy(policy)
    callables = [
        {"method": "_set_state", "args": {"state": {"value": "state"}}},
        {"method": "_set_goal_state", "args": {"goal_state": {"value": "goal_state"}}},
    ]
    result = world.evaluate(
        dataset=dataset, episodes_idx=[0, 2, 1], start_steps=[5, 0, 7], goal_offset=20, eval_budget=3, callables=callables
    )
    assert len(result["episode_successes"]) == 3 and max(result["episode_lengths"]) <= 3
    chunks = dataset.load_chunk(np.array([0, 2]), np.array([5, 0]), np.array([26, 21]))
    assert policy.first is not None
    for row, chunk in enumerate(chunks):
        states = np.asarray(chunk["state"])
        np.testing.assert_array_equal(policy.first["state"][row, 0, :5], states[0, :5])
        np.testing.assert_array_equal(policy.first["goal_state"][row, 0, :5], states[20, :5])


def test_rows_that_do_not_fit_are_refused(recorded: Path) -> None:
    dataset = swm.data.load_dataset(str(recorded))
    world = make(1)
    world.set_policy("random")
    rows: dict[str, Any] = {"dataset": dataset, "episodes_idx": [0], "goal_offset": 5, "eval_budget": 5}
    with pytest.raises(ValueError, match="start_steps"):
        world.evaluate(**rows)
    with pytest.raises(ValueError, match="1 episodes_idx and 2 start_steps"):
        world.evaluate(**rows, start_steps=[0, 1])
    with pytest.raises(ValueError, match="_paint"):
        world.evaluate(**rows, start_steps=[0], callables=[{"method": "_paint"}])
    with pytest.raises(ValueError, match="fewer episodes"):
        swm.evaluate_from_dataset(world, dataset, episodes=10_000)
    with pytest.raises(ValueError, match="frame skip"):
        other = make(1, frame_skip=2)
        other.set_policy("random")
        other.evaluate(**rows, start_steps=[0])
    with pytest.raises(ValueError, match="PushT"):
        other = swm.World("swm/TwoRoom-v2", 1, image_shape=(32, 32))
        other.set_policy("random")
        other.evaluate(**rows, start_steps=[0])


def test_options_of_single_episodes() -> None:
    world = make(2, max_episode_steps=3)
    world.set_policy("random")
    result = world.evaluate(episodes=3, seed=0, options=[{"variation": []}] * 3)
    assert result["setup"]["from_recorded_rows"] and result["episodes"] == 3
    with pytest.raises(swm.SwmError, match="2 dicts for 3 episodes"):
        world.evaluate(episodes=3, seed=0, options=[{}] * 2)


def test_videos_are_written(tmp_path: Path) -> None:
    world = make(2, max_episode_steps=3)
    world.set_policy("random")
    result = world.evaluate(episodes=3, seed=0, video=tmp_path / "videos")
    assert [Path(path).stem for path in result["videos"]] == ["episode_0", "episode_1", "episode_2"]
    assert all(Path(path).stat().st_size > 100 for path in result["videos"])
    assert "base64" in result._repr_html_()
    plain = swm.World("swm/PushT-v1", 1, add_pixels=False)
    plain.set_policy("random")
    with pytest.raises(swm.SwmError, match="image_shape"):
        plain.evaluate(episodes=1, seed=0, video=tmp_path)


def test_success_by_a_rule() -> None:
    world = make(2, max_episode_steps=5)
    world.set_policy("random")
    anywhere = {"all": [{"column": "block_pose", "goal": "goal_pose", "measure": "largest", "below": 1e6}]}
    world.set_success(anywhere)
    assert world.evaluate(episodes=3, seed=0)["success_rate"] == 100.0
    world.set_success(None)
    assert world.evaluate(episodes=3, seed=0)["success_rate"] == 0.0


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("manifest") / "m.toml"
    made = swm.make_manifest(path, "swm/PushT-v1", episodes=4, tier="moderate", budget=12, variation=["agent.color"])
    assert made == swm.read_manifest(path) and len(made["pairs"]) == 4
    return path


def test_a_receipt_is_the_commands(manifest: Path, tmp_path: Path) -> None:
    # As the command names it, too.
    ours = swm.evaluate(manifest, "weak", tmp_path / "ours", references=["random", "no-op"], progress=False)
    command(
        *("eval", "--manifest", str(manifest), "--policy", "weak", "--reference", "random,no-op"),
        *("--out", str(tmp_path / "theirs")),
    )
    theirs = swm.read_receipt(tmp_path / "theirs")
    assert {**ours, "wall_time_s": 0} == {**theirs, "wall_time_s": 0}
    assert swm.read_receipt(tmp_path / "ours") == ours
    assert swm.verify(ours, progress=False)["equal"]


def test_a_python_policy_gets_the_receipt_of_a_native_one(manifest: Path, tmp_path: Path) -> None:
    class Zero:
        def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
            return np.zeros((len(infos["state"]), 2))

    zero = swm.evaluate(manifest, Zero(), tmp_path, references=["random"], num_envs=3, progress=False)
    native = swm.evaluate(manifest, "constant", references=[], progress=False)
    assert zero["episodes"] == native["episodes"] and zero["policy"] == "Zero"
    assert zero["references"][0]["role"] == "random"
    # Its name does not tell whether it is the same policy.
    with pytest.raises(swm.SwmError, match="`Zero`, a policy in Python.*again=True to replace it"):
        swm.evaluate(manifest, Zero(), tmp_path, references=[], progress=False)
    again = swm.evaluate(manifest, Zero(), tmp_path, references=[], again=True, progress=False)
    assert again["episodes"] == zero["episodes"] and again["references"] == []
    compared = swm.compare(native, tmp_path)
    assert compared[1]["test"]["difference"] == 0.0 and compared[0]["test"] is None
    assert [side["name"] for side in compared] == [native["policy"], str(tmp_path)]
    assert "Zero" in compared._repr_html_() and "Zero" in repr(zero)


def test_a_manifest_is_replaced_on_request_only(tmp_path: Path) -> None:
    path = tmp_path / "task.toml"
    made = swm.make_manifest(path, "swm/TwoRoom-v2", episodes=2)
    assert swm.make_manifest(path, "swm/TwoRoom-v2", episodes=2) == made
    with pytest.raises(swm.SwmError, match=r"task.toml holds another manifest .*2 pairs.*or overwrite=True to replace it"):
        swm.make_manifest(path, "swm/TwoRoom-v2", episodes=3)
    assert swm.read_manifest(path) == made
    assert len(swm.make_manifest(path, "swm/TwoRoom-v2", episodes=3, overwrite=True)["pairs"]) == 3
    assert len(swm.read_manifest(path)["pairs"]) == 3
    for wrong in [{"seed": "a"}, {"episodes": -3}, {"budget": 2.5}, {"frame_skip": 2**40}]:
        with pytest.raises(swm.SwmError, match=f"{next(iter(wrong))}=.*must be a whole number"):
            swm.make_manifest(tmp_path / "wrong.toml", "swm/TwoRoom-v2", **wrong)  # type: ignore[arg-type]
    seeded = swm.make_manifest(tmp_path / "seeded.toml", "swm/TwoRoom-v2", np.int64(2), seed=np.uint8(7))  # type: ignore[arg-type]
    assert seeded["pairs"] == swm.make_manifest(tmp_path / "same.toml", "swm/TwoRoom-v2", 2, seed=7)["pairs"]
    (tmp_path / "notes.toml").write_text("notes")
    with pytest.raises(swm.SwmError, match="is no manifest; give another path, or overwrite=True"):
        swm.make_manifest(tmp_path / "notes.toml", "swm/TwoRoom-v2", episodes=2)


def test_manifests_that_nothing_could_run_are_not_written(tmp_path: Path, pusht_file: Path) -> None:
    path = tmp_path / "m.toml"
    recorded = {"dataset": pusht_file, "goal_offset": 5}
    for wrong, words in (
        ({"budget": 0}, "budget=0: no action is allowed; use 1 or more"),
        ({"distractors": ["noise"]}, "there are none; give image_shape="),
        ({**recorded, "held_out": 0.0}, "held_out.*above 0 and at most 1"),
        ({**recorded, "held_out": 1.5}, "held_out.*above 0 and at most 1"),
        ({**recorded, "budget": 0}, "budget=0: no action is allowed"),
        ({"episodes": 0}, "0 pairs"),
    ):
        with pytest.raises(swm.SwmError, match=words):
            swm.make_manifest(path, "swm/PushT-v1", **{"episodes": 2, **wrong})  # type: ignore[arg-type]
        assert not path.exists(), wrong
    swm.make_manifest(path, "swm/PushT-v1", 2, distractors=["noise"], image_shape=(32, 32))
    assert swm.read_manifest(path)["distractors"] == ["noise"]


def test_a_result_is_replaced_on_request_only(manifest: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    out = tmp_path / "result"
    first = swm.evaluate(manifest, "random", out, references=[], progress=False)
    with pytest.raises(swm.SwmError, match="policy `random`, not `weak`; give another out, or again=True to replace it"):
        swm.evaluate(manifest, "weak", out, references=[], progress=False)
    with pytest.raises(swm.SwmError, match="policy seed 0, not 1"):
        swm.evaluate(manifest, "random", out, references=[], policy_seed=1, progress=False)
    with pytest.raises(swm.SwmError, match="plans of 25 actions, not of 5"):
        swm.evaluate(manifest, "random", out, references=[], plan_steps=5, progress=False)
    with pytest.raises(swm.SwmError, match="policy `random`, not `forgets`"):
        swm.evaluate(manifest, _Forgets(), out, references=[], progress=False)
    assert swm.read_receipt(out) == first and not caplog.records
    # The same one is not run again: even the seconds that it took are those of the first.
    assert swm.evaluate(manifest, "random", out, references=[], progress=False) == first
    assert "result/receipt.json: already done; give again=True to repeat it" in caplog.text
    # A missing reference policy is added.
    more = swm.evaluate(manifest, "random", out, references=["no_op"], progress=False)
    assert more["wall_time_s"] == first["wall_time_s"] and [one["role"] for one in more["references"]] == ["no_op"]
    other = swm.evaluate(manifest, "weak", out, references=[], again=True, progress=False)
    assert swm.read_receipt(out) == other and other["policy"] != first["policy"]


class _Forgets:
    def describe(self) -> str:
        return "forgets"

    def get_action(self, infos: dict[str, np.ndarray]) -> None:
        """Not asked: the folder is looked at first."""


def test_every_policy_has_a_bar_of_its_name(manifest: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tqdm")
    receipt = swm.evaluate(manifest, "weak", references=["random", "no_op"])
    shown = capsys.readouterr().err
    for label in ("Evaluating weak:", "Evaluating random (reference):", "Evaluating no_op (reference):"):
        assert label in shown, shown
    assert shown.count("4/4") >= 3
    swm.verify(receipt)
    shown = capsys.readouterr().err
    assert "12/12" in shown and "12episode" not in shown and "episodes/s" in shown, shown


def test_manifests_that_do_not_exist_or_were_changed_are_refused(manifest: Path, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        swm.read_manifest(tmp_path / "none.toml")
    changed = tmp_path / "changed.toml"
    changed.write_text(manifest.read_text().replace("budget = 12", "budget = 13"))
    with pytest.raises(swm.SwmError, match="was changed"):
        swm.read_manifest(changed)
    with pytest.raises(swm.SwmError, match="no reference policy"):
        swm.evaluate(manifest, "random", references=["best"], progress=False)


def test_a_replay_repeats_the_recorded_rows(recorded: Path) -> None:
    report = swm.replay(recorded, progress=False)
    assert report["ok"] and report["episodes"] == 4
    assert all(column["max_abs"] == 0 for column in report["columns"].values())
    moved = swm.replay(recorded, [0], variation_values={"agent.start_position": [50.0, 60.0]}, progress=False)
    assert not moved["ok"]
    with pytest.raises(swm.SwmError, match="no episode 9"):
        swm.replay(recorded, [9], progress=False)
    with pytest.raises(swm.SwmError, match="tolerance=-1.0: use a number of 0 or more"):
        swm.replay(recorded, tolerance=-1.0, progress=False)
