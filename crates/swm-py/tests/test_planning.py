"""Objectives, and the cost that a world model and an objective make."""

from __future__ import annotations

import pytest
import stable_worldmodel_rs as swm
from solver_helpers import configured
from stable_worldmodel_rs import protocols

torch = pytest.importorskip("torch")

from stable_worldmodel_rs.planning import (  # noqa: E402
    CEMSolver,
    ControlPenalty,
    GoalMSE,
    GradientSolver,
    LagrangianSolver,
    ShootingCostEvaluator,
    WeightedSum,
    default_goal_encode,
)
from stable_worldmodel_rs.planning.solver.utils import prepare_init_action  # noqa: E402

B, S, T, H, D = 2, 3, 2, 3, 4


class Latent(torch.nn.Module):
    """Encodes pixels by their mean, and moves the latent by the sum of the actions."""

    def __init__(self):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.tensor(0.5))
        self.encoded = 0

    def encode(self, x):
        self.encoded += 1
        self.keys = set(x)
        return {**x, "emb": x["pixels"].flatten(2).mean(-1, keepdim=True)}

    def rollout(self, info, candidates):
        start = info["pixels"].flatten(3).mean(-1, keepdim=True)
        moved = start[:, :, -1:] + self.weight * candidates.sum(-1, keepdim=True).cumsum(2)
        info["predicted_emb"] = torch.cat([start, moved], dim=2)
        return info


def observed():
    torch.manual_seed(0)
    pixels, goal = torch.rand(B, T, 3, 4, 4), torch.rand(B, 1, 3, 4, 4)
    return {"pixels": pixels, "goal": goal, "goal_proprio": torch.rand(B, 1, 2), "action": torch.zeros(B, 1, 2)}


def test_goal_mse():
    predicted, goal = torch.rand(B, S, T, 5, 6), torch.rand(B, 2, 5, 6)
    info = {"predicted_emb": predicted, "goal_emb": goal}
    expected = ((predicted[:, :, -1] - goal[:, None, -1]) ** 2).flatten(2)
    torch.testing.assert_close(GoalMSE()(info), expected.sum(-1))
    torch.testing.assert_close(GoalMSE(reduction="mean")(info), expected.mean(-1))
    with pytest.raises(ValueError, match="reduction must be 'sum' or 'mean'"):
        GoalMSE(reduction="max")
    predicted.requires_grad_(True)
    goal.requires_grad_(True)
    GoalMSE()(info).sum().backward()
    assert predicted.grad is not None and goal.grad is None


def test_weighted_sums_of_any_objective():
    info = {"action_candidates": torch.rand(B, S, H, D)}
    penalty = ControlPenalty()
    torch.testing.assert_close(penalty(info), info["action_candidates"].pow(2).sum(dim=(2, 3)))
    torch.testing.assert_close(WeightedSum([(2.0, penalty), (0.5, penalty)])(info), 2.5 * penalty(info))
    mixed = WeightedSum([(1.0, penalty), (3.0, lambda info: info["action_candidates"][..., 0, 0])])
    torch.testing.assert_close(mixed(info), penalty(info) + 3 * info["action_candidates"][..., 0, 0])
    with pytest.raises(ValueError, match="one term or more"):
        WeightedSum([])


def test_the_goal_is_encoded_once_per_plan():
    model = Latent()
    cost = ShootingCostEvaluator(model, GoalMSE())
    assert isinstance(cost, protocols.Costable) and not isinstance(cost, protocols.Constrainable)
    assert next(cost.parameters()) is model.weight
    result = configured(CEMSolver(cost, B, n_steps=5), n_envs=B).solve(observed())
    assert model.encoded == 1 and model.keys == {"pixels", "goal", "proprio"}
    assert result["actions"].shape == (B, 3, 4)
    moved = model.rollout({"pixels": observed()["pixels"][:, None]}, result["actions"][:, None])
    goal = observed()["goal"].flatten(2).mean(-1)
    torch.testing.assert_close(moved["predicted_emb"][:, 0, -1], goal, atol=0.05, rtol=0)


def test_images_arrive_as_the_docs_say():
    class Sees(Latent):
        def encode(self, x):
            self.of_encode = x["pixels"]
            return {**x, "emb": x["pixels"].float().flatten(2).mean(-1, keepdim=True)}

        def rollout(self, info, candidates):
            self.of_rollout, self.moved = info, candidates.shape
            start = info["pixels"].float().flatten(3).mean(-1, keepdim=True)
            moved = start[:, :, -1:] + self.weight * candidates.sum(-1, keepdim=True).cumsum(2)
            return {**info, "predicted_emb": torch.cat([start, moved], dim=2)}

    given = []

    def scaled(image):
        given.append(image)
        return image.float() / 255

    for transform, image, dtype in ((None, (16, 24, 3), torch.uint8), (scaled, (3, 16, 24), torch.float32)):
        for frames in (1, 2):
            model = Sees().requires_grad_(False)
            solver = CEMSolver(ShootingCostEvaluator(model, GoalMSE()), batch_size=2, num_samples=6, n_steps=2, topk=3)
            config = swm.PlanConfig(horizon=3, receding_horizon=1, history_len=frames, action_block=2)
            transforms = None if transform is None else {"pixels": transform, "goal": transform}
            world = swm.World("swm/PushT-v1", 2, (16, 24), max_episode_steps=6, threads=1)
            world.set_policy(swm.WorldModelPolicy(solver, config, transform=transforms))
            world.evaluate(episodes=2, seed=0)
            assert model.of_encode.shape == (2, 1, *image) and model.of_encode.dtype == dtype
            info = model.of_rollout
            assert info["pixels"].shape == (2, 6, frames, *image) and info["pixels"].dtype == dtype
            assert model.moved == (2, 6, 3, 4)
            assert ("action_history" in info) == (frames > 1)
            if frames > 1:
                assert info["action_history"].shape == (2, 6, 1, 4)
            assert info["state"].dtype == torch.float32
    assert given[0].shape == (3, 16, 24) and given[0].dtype == torch.uint8


def test_descent_through_a_model():
    model = Latent()
    solver = GradientSolver(ShootingCostEvaluator(model, GoalMSE()), 50, optimizer_kwargs={"lr": 0.05})
    result = configured(solver, n_envs=B).solve(observed())
    assert max(result["costs"]) < 1e-4 and model.encoded == 1 and model.weight.grad is None


def test_constraints_of_an_evaluator():
    cost = ShootingCostEvaluator(
        Latent(), GoalMSE(), constraints=[lambda info: info["action_candidates"].abs().mean(dim=(2, 3)) - 0.1]
    )
    assert isinstance(cost, protocols.Constrainable)
    solver = LagrangianSolver(cost, 20, 4, form="standard", optimizer_kwargs={"lr": 0.02})
    result = configured(solver, n_envs=B).solve(observed())
    assert result["lambdas"].shape == (B, 1)
    assert result["actions"].abs().mean(dim=(1, 2)).max() < 0.11


def test_goals_of_joined_latents():
    class Split:
        extra_encoders = {"proprio": None, "action": None}

        def encode(self, x, target, pixels_key, prefix, emb_keys):
            assert (target, pixels_key, prefix, emb_keys) == ("goal_emb", "goal", "goal_", ["proprio"])
            return {**x, "goal_emb": x["goal"], "pixels_goal_emb": x["goal"] + 1, "proprio_goal_emb": x["goal_proprio"]}

    info = {key: value[:, None].expand(B, S, *value.shape[1:]) for key, value in observed().items()}
    encoded = default_goal_encode(Split(), info)
    torch.testing.assert_close(encoded, observed()["goal"])
    torch.testing.assert_close(info["proprio_goal_emb"], observed()["goal_proprio"])
    with pytest.raises(AssertionError, match=r"goal not in info_dict.*image_shape=\(H, W\).*encode_goal=lambda model, info"):
        default_goal_encode(Latent(), {"pixels": torch.zeros(1, 1, 1)})


def test_plans_to_begin_with():
    begun = prepare_init_action(object(), {}, torch.ones(2, 1, 4), 3, n_envs=2, action_dim=4)
    assert begun.shape == (2, 3, 4) and begun[:, 0].all() and not begun[:, 1:].any()
    assert prepare_init_action(object(), {}, begun, 3, n_envs=2, action_dim=4) is begun
    assert prepare_init_action(object(), {}, None, 3, 2, 4, device="meta").device.type == "meta"
    with pytest.raises(AssertionError, match=r"give \(2, t, 5\)"):
        prepare_init_action(object(), {}, begun, 3, n_envs=2, action_dim=5)


def test_names_are_found_in_the_package():
    assert swm.planning.ShootingCostEvaluator is ShootingCostEvaluator
    assert set(swm.planning.__all__) >= {"CEMSolver", "GoalMSE", "Costable"}
    for name in swm.planning.__all__:
        assert getattr(swm.planning, name) is not None
