"""Policies in Python are first-class: sweeps, parts, resumed runs, settings and weights in receipts, verification, comparison."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs.planning import CEMSolver
from stable_worldmodel_rs.world.candidates import settings_of

from test_evaluate import command


class Follow:
    """Moves toward the goal; ``gain`` is a setting, ``calls`` is not."""

    def __init__(self, gain: float = 0.02) -> None:
        self.gain = gain
        self.calls = 0

    def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
        self.calls += 1
        toward = infos["goal_state"][:, 0, 2:4] - infos["state"][:, 0, :2]
        return (self.gain * toward).clip(-1, 1).astype("float32")


class AgentToGoal:
    array_api = "numpy"

    def get_cost(self, infos: dict[str, Any], candidates: np.ndarray) -> np.ndarray:
        moves = 40 * candidates.reshape(*candidates.shape[:2], -1, 2).sum(axis=2)
        agent, goal = infos["state"][:, :, -1, :2], infos["goal_state"][:, :, -1, :2]
        return np.linalg.norm(agent + moves - goal, axis=-1)


def planner(samples: int = 20) -> swm.WorldModelPolicy:
    solver = CEMSolver(AgentToGoal(), num_samples=samples, n_steps=2, topk=4)
    config = swm.PlanConfig(horizon=2, receding_horizon=1, action_block=4)
    return swm.WorldModelPolicy(solver, config, process={"action": swm.data.ZScoreScaler().fit(np.eye(2))})


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("manifest") / "m.toml"
    swm.make_manifest(path, "swm/PushT-v1", episodes=6, budget=12)
    return path


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    path = tmp_path / "weights.bin"
    path.write_bytes(b"weights")
    return path


def cells(sweep: dict[str, Any]) -> Any:
    """What came out in a sweep, without what the policy is called."""
    return [(cell["name"], cell["value"], cell["successes"], cell.get("summary"), cell.get("note")) for cell in sweep["cells"]]


def test_a_sweep_of_a_policy_in_python_is_that_of_the_same_policy_in_the_core(manifest: Path, tmp_path: Path) -> None:
    def zero(infos: dict[str, np.ndarray]) -> np.ndarray:
        return np.zeros((len(infos["state"]), 2))

    factors, seen = ["agent.scale", "block.shape", "agent.scale+block.shape"], []
    for num_envs in (1, 4):
        ours = swm.sweep(manifest, zero, factors, values="extremes", num_envs=num_envs, progress=False)
        seen.append(cells(ours))
    native = swm.sweep(manifest, "no-op", factors, tmp_path / "native", values="extremes", progress=False)
    assert seen == [cells(native)] * 2 and len(native["cells"]) == 7
    assert (ours["policy"], native["policy"]) == ("zero", "constant")
    receipt = swm.evaluate(manifest, zero, references=["random"], progress=False)
    assert receipt.success_rate == receipt["summary"]["success_rate"] == native["cells"][0]["summary"]["success_rate"]
    low, high = receipt.interval
    assert low <= receipt.success_rate <= high and not receipt.episode_successes.any() and "random" in repr(receipt)
    theirs = command(
        *("sweep", "--manifest", str(manifest), "--policy", "no-op", "--factors", ",".join(factors), "--values", "extremes")
    )
    assert native == theirs and swm.read_sweep(tmp_path / "native") == native
    assert "agent.scale" in repr(native) and "agent.scale" in native._repr_html_()
    assert {path.name for path in (tmp_path / "native").iterdir()} == {"sweep.json", "sweep.csv", "sweep.svg"}


def test_parts_of_a_policy_in_python_join_to_the_whole(manifest: Path, tmp_path: Path, weights: Path) -> None:
    asked: dict[str, Any] = {"weights": [weights], "name": "follow", "progress": False}
    whole = swm.evaluate(manifest, Follow(), references=["random"], **asked)
    swept = swm.sweep(manifest, Follow(), "agent", **asked)
    for part in (3, 1, 2):
        assert swm.evaluate(manifest, Follow(), tmp_path / "e", references=["random"], shard=(part, 3), num_envs=part, **asked) is None
        assert swm.sweep(manifest, Follow(), "agent", out=tmp_path / "s", shard=(part, 3), **asked) is None
    joined = swm.evaluate(manifest, Follow(), tmp_path / "e", references=["random"], join=True, **asked)
    assert {**joined, "wall_time_s": 0} == {**whole, "wall_time_s": 0} and swm.same(whole, tmp_path / "e")
    assert swm.sweep(manifest, Follow(), "agent", tmp_path / "s", join=True, **asked) == swept
    assert swept["files"] == whole["files"] and list(swept["files"]) == [str(weights)]


def test_parts_that_could_not_be_joined_are_refused(manifest: Path, tmp_path: Path, weights: Path) -> None:
    for wrong, message in [
        ({"out": tmp_path}, "give weights="),
        ({"weights": [weights]}, "need out="),
        ({"out": tmp_path, "weights": [weights], "again": True}, "again=True goes with whole runs"),
        ({"out": tmp_path, "weights": [weights], "join": True}, "give one of them"),
    ]:
        for run in (swm.evaluate, swm.sweep):
            with pytest.raises(ValueError, match=message):
                run(manifest, Follow(), shard=(1, 2), progress=False, **wrong)  # type: ignore[call-overload]
    with pytest.raises(ValueError, match=r"shard=\(3, 2\): give \(i, n\)"):
        swm.evaluate(manifest, Follow(), tmp_path, shard=(3, 2), weights=[weights])
    swm.evaluate(manifest, Follow(), tmp_path / "e", references=[], weights=[weights], shard=(1, 2), progress=False)
    with pytest.raises(swm.SwmError, match="2/2 is missing"):
        swm.evaluate(manifest, Follow(), tmp_path / "e", references=[], weights=[weights], join=True, progress=False)


class _Ends(Exception):
    """Ends a run."""


class Interrupted(Follow):
    """As Follow, and ends the run at a call."""

    def __init__(self, gain: float = 0.02, end: int | None = None) -> None:
        super().__init__(gain)
        self.last_call = end

    def settings(self) -> dict[str, Any]:
        return {"gain": self.gain}

    def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
        if self.calls == self.last_call:
            raise _Ends
        return super().get_action(infos)


@pytest.mark.parametrize("run", [swm.evaluate, swm.sweep])
def test_an_interrupted_run_with_weights_goes_on(
    run: Callable[..., Any], manifest: Path, tmp_path: Path, weights: Path, caplog: pytest.LogCaptureFixture
) -> None:
    asked: dict[str, Any] = {"weights": [weights], "num_envs": 1, "progress": False}
    asked |= {"references": []} if run is swm.evaluate else {"factors": "agent.scale"}
    whole = run(manifest, uninterrupted := Interrupted(), **asked)
    with pytest.raises(_Ends):
        run(manifest, Interrupted(end=40), out=tmp_path / "out", **asked)
    again = run(manifest, second := Interrupted(), out=tmp_path / "out", **asked)
    assert {**again, "wall_time_s": 0} == {**whole, "wall_time_s": 0}
    # 3 episodes of 12 steps were there.
    assert second.calls == uninterrupted.calls - 36
    assert run(manifest, third := Interrupted(), out=tmp_path / "out", **asked) == again and third.calls == 0
    assert "already done; " in caplog.text and "again=True" in caplog.text
    weights.write_bytes(b"trained anew")
    with pytest.raises(swm.SwmError, match="have changed since.*again=True to replace it"):
        run(manifest, Interrupted(), out=tmp_path / "out", **asked)
    with pytest.raises(swm.SwmError, match="gain=0.5"):
        run(manifest, Interrupted(0.5), out=tmp_path / "out", **asked)
    replaced = run(manifest, Interrupted(0.5), out=tmp_path / "out", again=True, **asked)
    assert replaced["candidate"]["policy"]["named"] == {"gain": 0.5}


@pytest.mark.parametrize("run", [swm.evaluate, swm.sweep])
def test_without_weights_nothing_is_taken_for_the_same(run: Callable[..., Any], manifest: Path, tmp_path: Path) -> None:
    asked: dict[str, Any] = {"out": tmp_path, "num_envs": 1, "progress": False}
    asked |= {"references": []} if run is swm.evaluate else {"factors": "agent.scale"}
    run(manifest, Follow(), **asked)
    with pytest.raises(swm.SwmError, match=r"a policy in Python.*weights.*, or again=True to replace it"):
        run(manifest, Follow(), **asked)
    assert run(manifest, Follow(), again=True, **asked)["policy"] == "Follow:gain=0.02"


def test_a_receipt_has_all_settings_of_a_planner_in_python(manifest: Path, weights: Path) -> None:
    receipt = swm.evaluate(manifest, planner(), references=[], weights=[weights], progress=False)
    settings = receipt["candidate"]["policy"]["named"]
    expected = {"samples": 20, "iterations": 2, "elites": 4, "horizon": 2, "receding_horizon": 1, "action_block": 4}
    assert expected.items() <= settings.items() and settings["history_len"] == 1 and settings["seed"] == 1234
    assert (settings["solver"], settings["cost"]) == ("CEMSolver", "AgentToGoal")
    assert settings["process.action"].startswith("ZScoreScaler#")
    assert receipt["candidate"]["policy"]["name"] == "WorldModelPolicy" and receipt["plan_steps"] == 4
    assert receipt["files"] == {str(weights): hashlib.sha256(b"weights").hexdigest()}
    # What the scaling was fitted to is a setting, too.
    other = planner()
    other.process["action"].fit(3 * np.eye(2))
    again = swm.evaluate(manifest, other, references=[], weights=[weights], progress=False)
    assert "process.action" in receipt.differences(again)


def test_settings_are_those_of_the_objects_that_a_policy_is_made_of() -> None:
    @dataclass
    class Config:
        horizon: int = 3
        clip: bool = True

    class Solver:
        def __init__(self, cost: object, noise: float = 0.5, device: str = "cpu") -> None:
            self.cost, self._noise, self.device = cost, noise, device

        def settings(self) -> dict[str, object]:
            return {"clip": False, "noise": self._noise}

    class Mine:
        def __init__(self, solver: object, config: object, transform: object, keys: tuple[str, ...], limit: float) -> None:
            self.solver, self.cfg, self.transform, self.keys, self.limit, self.count = solver, config, transform, keys, limit, 3

        def get_action(self, infos: object) -> None:
            """Not asked."""

    made = Mine(Solver(AgentToGoal()), Config(), {"pixels": np.asarray}, ("pixels", "state"), float("inf"))
    assert settings_of(made) == {
        **{"solver": "Solver", "clip": False, "noise": 0.5, "cost": "AgentToGoal", "horizon": 3, "config.clip": True},
        **{"transform.pixels": "asarray", "keys": ["pixels", "state"], "limit": "inf"},
    }


def test_verify_repeats_a_policy_in_python(manifest: Path, tmp_path: Path, weights: Path) -> None:
    receipt = swm.evaluate(manifest, planner(), references=["random"], weights=[weights], name="mine", progress=False)
    elsewhere = tmp_path / "elsewhere" / "copy.bin"
    elsewhere.parent.mkdir()
    elsewhere.write_bytes(weights.read_bytes())
    for given in ({}, {"weights": [elsewhere], "num_envs": 2}):
        told = swm.verify(receipt, planner(), progress=False, **given)  # type: ignore[arg-type]
        assert told["equal"] and not told["differences"], told
    elsewhere.write_bytes(b"trained anew")
    told = swm.verify(receipt, planner(), weights=[elsewhere], progress=False)
    assert not told["equal"] and set(told["differences"]) == {"model"} and "none of the given files" in told["differences"]["model"]
    told = swm.verify(receipt, planner(samples=21), progress=False)
    assert "samples: recorded 20, now 21" in told["differences"]["solver"]
    weights.unlink()
    assert "model" in swm.verify(receipt, planner(), progress=False)["differences"]
    with pytest.raises(swm.SwmError, match=r"the policy `mine` was an object.*swm.verify\(receipt, policy=…, weights=\[…\]\)"):
        swm.verify(receipt, progress=False)
    with pytest.raises(TypeError, match="the receipt names policies of the core"):
        swm.verify(receipt, "cem", progress=False)


def test_a_policy_in_python_is_not_taken_for_one_of_the_core(manifest: Path) -> None:
    def random(infos: dict[str, np.ndarray]) -> np.ndarray:
        return np.zeros((len(infos["state"]), 2))

    receipt = swm.evaluate(manifest, random, references=[], progress=False)
    assert receipt["policy"] == "random (Python)"
    with pytest.raises(swm.SwmError, match="was an object of the program"):
        swm.verify(receipt, progress=False)
    for wrong in ({"name": "mine"}, {"weights": ["w.pt"]}, {"image_shape": (8, 8)}):
        with pytest.raises(TypeError, match=f"{next(iter(wrong))}: for policies in Python"):
            swm.evaluate(manifest, "random", references=[], progress=False, **wrong)  # type: ignore[call-overload]
    with pytest.raises(FileNotFoundError, match="w.pt, one of weights"):
        swm.evaluate(manifest, random, references=[], weights=["w.pt"], progress=False)
    with pytest.raises(TypeError, match=r"weights=\['w.pt'\]"):
        swm.evaluate(manifest, random, references=[], weights="w.pt", progress=False)


def test_compare_shows_what_differs_and_same_whether(manifest: Path, tmp_path: Path, weights: Path) -> None:
    one = swm.evaluate(manifest, planner(), tmp_path / "a", references=[], weights=[weights], name="mine", progress=False)
    weights.write_bytes(b"trained anew")
    two = swm.evaluate(manifest, planner(24), tmp_path / "b", references=[], weights=[weights], name="mine", progress=False)
    compared = swm.compare(tmp_path / "a", tmp_path / "b")
    differs = {entry["what"]: (entry["first"], entry["this"]) for entry in compared[1]["differs"]}
    assert differs["samples"] == (20, 24) and set(differs) == {"samples", "weights"} and compared[0]["differs"] == []
    assert "samples" in repr(compared) and "24 (first: 20)" in compared._repr_html_()
    assert not swm.same(one, two) and swm.same(one, tmp_path / "a") and swm.same(one, json.loads(json.dumps(one)))
    assert one.differences(two)["samples"] == (20, 24) and one.differences(one) == {}
    # As the command shows them.
    assert [side.get("differs", []) for side in command("compare", str(tmp_path / "a"), str(tmp_path / "b"))] == [
        side["differs"] for side in compared
    ]
    # What came out is compared, too, and where it was run is not.
    moved = json.loads(json.dumps(one))
    moved["files"] = {"/elsewhere/weights.bin": next(iter(one["files"].values()))}
    assert swm.same(one, moved)
    moved["episodes"][2]["success"] = not moved["episodes"][2]["success"]
    assert list(one.differences(moved)) == ["outcomes (1 of 6 episodes)"]


def test_native_results_differ_by_seed_and_settings(manifest: Path) -> None:
    first = swm.evaluate(manifest, "weak", references=[], progress=False)
    second = swm.evaluate(manifest, "weak", references=[], policy_seed=2, progress=False)
    assert set(first.differences(second)) >= {"policy_seed"}
    assert swm.same(first, swm.evaluate(manifest, "weak", references=[], num_envs=2, progress=False))
    plan = swm.compare(
        *(swm.evaluate(manifest, f"cem:samples={n},iterations=1,elites=2", references=[], progress=False) for n in (4, 6))
    )
    assert [entry["what"] for entry in plan[1]["differs"]] == ["samples"]


def test_results_are_written_as_json(manifest: Path, tmp_path: Path, world: Callable[..., Any]) -> None:
    one = world()
    one.set_policy("random")
    result = one.evaluate(episodes=2, seed=1)
    text = result.to_json(tmp_path / "result.json")
    assert json.loads(text) == json.loads((tmp_path / "result.json").read_text()) == json.loads(json.dumps(result.plain()))
    assert json.loads(text)["episode_successes"] == result["episode_successes"].tolist()
    assert set(json.loads(text)) == set(result)
    result["episode_returns"][0] = np.nan
    assert json.loads(result.to_json())["episode_returns"][0] is None
    receipt = swm.evaluate(manifest, "random", references=[], progress=False)
    swept = swm.sweep(manifest, "random", "agent.scale", progress=False)
    for other in (receipt, swept, swm.compare(receipt), swm.read_manifest(manifest)):
        assert json.loads(json.dumps(other)) == other


def test_sweeps_refuse_what_they_do_not_know(manifest: Path, tmp_path: Path) -> None:
    for wrong, message in [
        ({"factors": "agent.sale"}, "unknown factor `agent.sale`.*agent.scale"),
        ({"values": "some"}, 'values="some": no way to choose values; use sampled or extremes or grid'),
        ({"points": 3}, 'points=3: is about a grid; give values="grid", or leave out points'),
        ({"values": "grid", "points": 1}, "use 2 or more"),
    ]:
        with pytest.raises(swm.SwmError, match=message):
            swm.sweep(manifest, "random", progress=False, **wrong)  # type: ignore[call-overload]
    swm.sweep(manifest, "random", "agent.scale", tmp_path, progress=False)
    with pytest.raises(swm.SwmError, match="policy `random`, not `weak`.*again=True to replace it"):
        swm.sweep(manifest, "weak", "agent.scale", tmp_path, progress=False)
    with pytest.raises(swm.SwmError, match="other factors or values"):
        swm.sweep(manifest, "random", "block.scale", tmp_path, progress=False)


def test_a_torch_planner_is_swept_divided_resumed_and_verified(manifest: Path, tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    from stable_worldmodel_rs.planning import GoalMSE, ShootingCostEvaluator

    class Model(torch.nn.Module):  # type: ignore[misc,name-defined]
        def __init__(self, dim: int = 2) -> None:
            super().__init__()
            self.speed = torch.nn.Linear(dim, dim, bias=False)

        def encode(self, x: dict[str, Any]) -> dict[str, Any]:
            return {**x, "emb": x["state"][..., :2].float()}

        def rollout(self, info: dict[str, Any], candidates: Any) -> dict[str, Any]:
            moves = self.speed(candidates.unflatten(-1, (-1, 2)).sum(-2)).cumsum(2)
            info["predicted_emb"] = info["state"][:, :, -1:, :2].float() + moves
            return info

    made = Model()
    made.speed.weight.data = 40 * torch.eye(2)
    torch.save(made.state_dict(), weights := tmp_path / "model.pt")

    def policy() -> swm.WorldModelPolicy:
        model = Model().eval().requires_grad_(False)
        model.load_state_dict(torch.load(weights, weights_only=True))
        cost = ShootingCostEvaluator(
            model, GoalMSE(), encode_goal=lambda model, info: model.encode({"state": info["goal_state"][:, 0]})["emb"]
        )
        config = swm.PlanConfig(horizon=2, receding_horizon=1, action_block=3)
        return swm.WorldModelPolicy(CEMSolver(cost, num_samples=16, n_steps=2, topk=4, batch_size=2), config)

    asked: dict[str, Any] = {"weights": [weights], "name": "agent", "progress": False}
    whole = swm.evaluate(manifest, policy(), references=[], num_envs=1, **asked)
    assert whole["files"] == {str(weights): hashlib.sha256(weights.read_bytes()).hexdigest()} and whole["plan_steps"] == 3
    settings = whole["candidate"]["policy"]["named"]
    assert {"cost.model": "Model", "cost.objective": "GoalMSE", "samples": 16, "horizon": 2}.items() <= settings.items()
    for part in (2, 1):
        swm.evaluate(manifest, policy(), tmp_path / "parts", references=[], num_envs=3, shard=(part, 2), **asked)
    joined = swm.evaluate(manifest, policy(), tmp_path / "parts", references=[], join=True, **asked)
    assert swm.same(whole, joined), whole.differences(joined)
    swept = [swm.sweep(manifest, policy(), "agent.scale", num_envs=count, **asked) for count in (1, 4)]
    assert swept[0] == swept[1] and swept[0]["cells"][0]["successes"] == whole.episode_successes.tolist()
    assert swm.verify(whole, policy(), weights=[weights], num_envs=4, progress=False)["equal"]
    made.speed.weight.data = -40 * torch.eye(2)
    torch.save(made.state_dict(), weights)
    told = swm.verify(whole, policy(), weights=[weights], progress=False)
    assert not told["equal"] and "model" in told["differences"] and told["episodes"]


def test_a_verification_names_what_it_did_not_check(manifest: Path, weights: Path) -> None:
    receipt = swm.evaluate(manifest, planner(), references=["random"], weights=[weights], progress=False)
    told = swm.verify(receipt, planner(), weights=[weights], progress=False)
    assert isinstance(told, swm.Verification) and told["equal"]
    assert {"model", "solver", "physics", "seed", "protocol", "those of random"} <= set(told["checked"])
    assert not any("weights" in what for what in told["not_checked"])

    bare = swm.evaluate(manifest, planner(), references=[], progress=False)
    told = swm.verify(bare, planner(), progress=False)
    assert told["equal"] and "model" not in told["checked"]
    missing = [what for what in told["not_checked"] if "the receipt has no hash of them; give weights=[…] to swm.evaluate" in what]
    assert len(missing) == 1 and any("reference policies: the evaluation had none" in what for what in told["not_checked"])
    shown = str(told)
    assert shown.startswith("equal: yes, in all that was checked") and f"not checked: {missing[0]}" in shown
    assert missing[0] in repr(told) and "not checked" in told._repr_html_()

    with_oracle = swm.evaluate(manifest, "random", references=["oracle"], oracle="cem:samples=8,iterations=1", progress=False)
    told = swm.verify(with_oracle, progress=False)
    assert any("the oracle was not run again" in what for what in told["not_checked"]) and "those of oracle" not in told["checked"]
    told = swm.verify(with_oracle, oracle=True, progress=False)
    assert "those of oracle" in told["checked"] and not any("oracle" in what for what in told["not_checked"])


def test_a_function_and_a_network_are_named_as_not_checked(manifest: Path) -> None:
    class Acts:
        def __init__(self, scale: object) -> None:
            self.scale = scale

        def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
            return np.zeros((len(infos["state"]), 2), np.float32)

    def halved(values: np.ndarray) -> np.ndarray:
        return values / 2

    receipt = swm.evaluate(manifest, Acts(halved), references=["random"], progress=False)
    told = swm.verify(receipt, Acts(halved), progress=False)
    assert any(what.startswith("scale: compared by name alone") for what in told["not_checked"]), told["not_checked"]
    torch = pytest.importorskip("torch")

    class Network(torch.nn.Module):  # type: ignore[misc,name-defined]
        def __init__(self) -> None:
            super().__init__()
            self.layer = torch.nn.Linear(1, 1)

    told = swm.verify(swm.evaluate(manifest, Acts(Network()), references=[], progress=False), Acts(Network()), progress=False)
    assert any(what.startswith("the weights of Network: the receipt has no hash of them") for what in told["not_checked"]), told["not_checked"]
