"""What models are given: scaled goals, histories, images, and what is refused before a long run begins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from stable_worldmodel_rs import HistoryBuffer, MpcPolicy, PlanConfig, WorldModelPolicy
from stable_worldmodel_rs.planning import CEMSolver, SimulatorCost
from stable_worldmodel_rs.world import World


class Half:
    """A scaling that halves."""

    def transform(self, values: Any) -> Any:
        return values / 2

    def inverse_transform(self, values: Any) -> Any:
        return values * 2


def _copied(value: Any) -> Any:
    return np.array(value.numpy() if hasattr(value, "numpy") else value)


class Look:
    """A cost that keeps what it was given."""

    array_api = "numpy"

    def __init__(self) -> None:
        self.seen: list[dict[str, Any]] = []

    def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
        self.seen.append({key: _copied(value) for key, value in infos.items() if not isinstance(value, list)})
        return np.asarray(candidates).sum((2, 3)) ** 2


class TorchLook(Look):
    array_api = "torch"

    def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
        super().get_cost(infos, candidates)
        return candidates.sum(dim=(2, 3)) ** 2


def planned(cost: Any, steps: int = 1, world: Any = None, config: PlanConfig | None = None, **policy: Any) -> Any:
    """The infos of the World, and what the cost was given last."""
    world = world or World("swm/PushT-v1", 2, None, 20, add_pixels=False, threads=1)
    solver = CEMSolver(cost, num_samples=8, n_steps=1, topk=3, batch_size=2)
    world.set_policy(WorldModelPolicy(solver, config or PlanConfig(2, 1), **policy))
    world.reset(seed=0)
    for _ in range(steps - 1):
        world.step()
    before = {name: np.array(values) for name, values in world.infos.items() if not isinstance(values, list)}
    world.step()
    return before, cost.seen[-1]


def test_a_goal_is_scaled_with_its_column() -> None:
    infos, seen = planned(Look(), process={"proprio": Half(), "state": Half()})
    for name in ("proprio", "goal_proprio", "state", "goal_state"):
        np.testing.assert_array_equal(seen[name][:, 0], infos[name] / 2)
    np.testing.assert_array_equal(seen["goal_pose"][:, 0], infos["goal_pose"])


def test_a_goal_may_have_a_scaling_of_its_own() -> None:
    class Tenth(Half):
        def transform(self, values: Any) -> Any:
            return values / 10

    infos, seen = planned(Look(), process={"proprio": Half(), "goal_proprio": Tenth()})
    np.testing.assert_array_equal(seen["goal_proprio"][:, 0], infos["goal_proprio"] / 10)
    # The reference's programs name a goal that an environment does not have.
    planned(Look(), process={"pos_agent": Half(), "goal_pos_agent": Half()})


def test_the_goal_image_is_transformed_as_the_image() -> None:
    pytest.importorskip("torch")
    world = World("swm/PushT-v1", 2, (16, 16), 20, threads=1)
    _, seen = planned(TorchLook(), world=world, transform={"pixels": lambda image: image.float() / 255})
    for name in ("pixels", "goal"):
        assert seen[name].shape == (2, 8, 1, 3, 16, 16) and seen[name].dtype == np.float32 and seen[name].max() <= 1
    _, seen = planned(TorchLook(), world=world, transform={"goal": lambda image: image.float()})
    assert seen["pixels"].dtype == np.uint8 and seen["goal"].max() > 1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"process": {"actions": Half()}}, r"process names 'actions', which is no column \(did you mean 'action'\?\)"),
        ({"process": {"propio": Half()}}, r"did you mean 'proprio'\?\); the columns are state, proprio, "),
        ({"process": {"goal_propio": Half()}}, r"process names 'goal_propio'.*did you mean 'goal_proprio'"),
        ({"transform": {"pixels": lambda image: image}}, r"transform names 'pixels'.*images need image_shape=\(H, W\)"),
        ({"history_keys": ("pixels",)}, r"history_keys names 'pixels'.*images need image_shape"),
        ({"history_keys": ("stat",)}, r"history_keys names 'stat'.*did you mean 'state'"),
    ],
)
def test_names_of_no_column_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        planned(Look(), config=PlanConfig(2, 1, history_len=2), **settings)


def test_a_text_is_no_list_of_columns() -> None:
    with pytest.raises(TypeError, match=r"history_keys='state' is a text; give a list: \['state'\]"):
        WorldModelPolicy(CEMSolver(Look()), PlanConfig(2, 1), history_keys="state")


def test_all_that_is_observed_has_a_history() -> None:
    """A column of one frame would spread over several of another without a word."""
    for cost in (Look(), TorchLook()):
        if isinstance(cost, TorchLook):
            pytest.importorskip("torch")
        world = World("swm/PushT-v1", 2, (16, 16), 20, threads=1)
        _, seen = planned(cost, steps=5, world=world, config=PlanConfig(2, 1, history_len=3, action_block=2))
        observed = world.envs.single_observation_space.spaces
        assert {"pixels", "state", "proprio"} <= observed.keys()
        assert {name: seen[name].shape[2] for name in observed} == dict.fromkeys(observed, 3)
        assert {seen[name].shape[2] for name in ("goal", "goal_state", "goal_proprio", "reward", "seed")} == {1}
        _, seen = planned(cost, steps=5, config=PlanConfig(2, 1, history_len=3, action_block=2), history_keys=("proprio",))
        assert (seen["proprio"].shape[2], seen["state"].shape[2]) == (3, 1)


@pytest.mark.parametrize("make", [Look, TorchLook])
def test_frames_of_a_history_are_those_that_were(make: Any) -> None:
    """Also where tensors lie on the arrays of the World, which it writes to again."""
    if make is TorchLook:
        pytest.importorskip("torch")
    cost, states, actions = make(), [], []
    world = World("swm/PushT-v1", 1, None, 20, add_pixels=False, threads=1)
    solver = CEMSolver(cost, num_samples=8, n_steps=1, topk=3)
    config = PlanConfig(2, 1, history_len=3, action_block=2)
    world.set_policy(WorldModelPolicy(solver, config, process={"state": Half()}))
    world.reset(seed=0)
    for _ in range(5):
        states.append(world.infos["state"][0, 0].copy())
        world.step()
        actions.append(world.infos["action"][0, 0].copy())
    wanted = (np.stack(states[0::2]) / 2).astype(cost.seen[-1]["state"].dtype)
    np.testing.assert_array_equal(cost.seen[-1]["state"][0, 0], wanted)
    assert len(np.unique(wanted[:, 0])) == 3
    np.testing.assert_array_equal(cost.seen[-1]["action_history"][0, 0], np.stack(actions[:4]).reshape(2, 4))


def test_a_buffer_keeps_copies_of_tensors() -> None:
    torch = pytest.importorskip("torch")
    buffer, state = HistoryBuffer(n_envs=1, max_len=3), torch.zeros(1, 1, 1)
    for step in range(3):
        state[:] = step
        buffer.append({"state": state})
    assert buffer.get(3)["state"].flatten().tolist() == [0, 1, 2]


class Bare:
    """Neither a cost nor a model."""


def test_what_has_no_cost_is_refused_when_it_is_given() -> None:
    needed = r"CEMSolver was given Bare, which has no get_cost\(info_dict, candidates\): costs \(B, S\) of candidates"
    with pytest.raises(TypeError, match=needed + r".*ShootingCostEvaluator\(model, objective\)"):
        CEMSolver(Bare())
    with pytest.raises(TypeError, match=r"was given the class Look; make an object of it: Look\("):
        CEMSolver(Look)
    with pytest.raises(swm.PlanError, match="SimulatorCost is in Rust; use MpcPolicy"):
        WorldModelPolicy(CEMSolver(SimulatorCost()), PlanConfig(2, 1))
    assert MpcPolicy(CEMSolver(None), SimulatorCost()).text.startswith("cem:")
    for size in (0, -1):
        with pytest.raises(ValueError, match="batch_size must be >= 1"):
            CEMSolver(Look(), batch_size=size)


def test_torch_modules_without_what_is_needed_are_refused() -> None:
    torch = pytest.importorskip("torch")
    from stable_worldmodel_rs.planning import GoalMSE, ShootingCostEvaluator

    layer = torch.nn.Linear(2, 2)
    with pytest.raises(TypeError, match=r"CEMSolver was given Linear, which has no get_cost"):
        CEMSolver(layer)
    with pytest.raises(TypeError, match=r"ShootingCostEvaluator was given Linear, which has no rollout\(info_dict, candidates\)"):
        ShootingCostEvaluator(layer, GoalMSE())
    with pytest.raises(TypeError, match=r"FeedForwardPolicy was given Linear, which has no get_action\(info\)"):
        swm.FeedForwardPolicy(layer)

    class World(torch.nn.Module):
        def rollout(self, info: Any, candidates: Any) -> Any:
            return info

    with pytest.raises(TypeError, match="objective .*; give a function or module"):
        ShootingCostEvaluator(World(), GoalMSE)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: planner(proces={"proprio": Half()}), TypeError, "WorldModelPolicy has no argument 'proces'; did you mean 'process'"),
        (lambda: swm.RandomPolicy(sed=3), TypeError, "RandomPolicy has no argument 'sed'; did you mean 'seed'"),
        (lambda: planner(process={"proprio": 3}), TypeError, r"process\['proprio'\] is 3; give an object with transform"),
        (lambda: planner(process={"proprio": Half}), TypeError, r"process\['proprio'\] is <class"),
        (lambda: planner(transform={"pixels": 3}), TypeError, r"transform\['pixels'\] is 3; give a function"),
        (lambda: WorldModelPolicy(CEMSolver(Look()), None), TypeError, r"config is None; give a PlanConfig\(horizon="),
        (lambda: planned(Look(), history_keys=("stat",)), ValueError, "history_keys names 'stat'.*did you mean 'state'"),
        (lambda: PlanConfig(2.5, 1), TypeError, "horizon must be a whole number, got 2.5"),
        (lambda: PlanConfig(2, 1, history_len=3, history_max_len=1), ValueError, "history_max_len=1 steps are fewer.*give 3 or"),
        (lambda: attached("cem"), TypeError, "'cem' is no solver"),
        (lambda: attached(CEMSolver), TypeError, "CEMSolver'> is no solver"),
        (lambda: planned(Look(), process={"action": swm.data.ZScoreScaler([np.nan, 0], [1, 1])}), ValueError, "are not finite"),
    ],
)
def test_other_mistakes_are_refused(make: Any, error: Any, message: str) -> None:
    with pytest.raises(error, match=message):
        make()


def planner(**settings: Any) -> WorldModelPolicy:
    return WorldModelPolicy(CEMSolver(Look()), PlanConfig(2, 1), **settings)


def attached(solver: Any) -> None:
    World("swm/PushT-v1", 1, None, add_pixels=False).set_policy(WorldModelPolicy(solver, PlanConfig(2, 1)))


def test_attributes_may_have_any_other_name() -> None:
    assert planner(run="a", note="b").note == "b"


def test_an_image_model_without_a_transform_is_told_so() -> None:
    torch = pytest.importorskip("torch")

    class Images(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.layer = torch.nn.Conv2d(3, 1, 3)

        def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
            self.layer(infos["pixels"].flatten(0, 2))
            return candidates.sum(dim=(2, 3))

    world = World("swm/PushT-v1", 2, (16, 16), 20, threads=1)
    with pytest.raises(RuntimeError) as caught:
        planned(Images(), world=world)
    note = "\n".join(getattr(caught.value, "__notes__", [str(caught.value)]))
    if hasattr(caught.value, "add_note"):
        assert "without a transform" in note and "uint8, (…, H, W, C) with (H, W, C) = (16, 16, 3)" in note
        assert 'transform={"pixels": lambda image: image.float() / 255}' in note
