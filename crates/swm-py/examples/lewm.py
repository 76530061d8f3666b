#!/usr/bin/env python3
"""Trains LeWM, the reference's own torch module, on clips of this package's Loader, and plans with it in PushT.

    pip install torch einops stable-worldmodel      # LeWM comes from there
    python lewm.py --episodes 200 --steps 5000 --image 64 --device cuda

The losses are those of the reference's scripts/train/lewm.py: the error of the predicted next embedding, and SIGReg. The
encoder is a small convolutional network in place of a vision transformer, so that a few steps run anywhere.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import compat
from stable_worldmodel_rs.data.normalization import ZScoreScaler
from stable_worldmodel_rs.planning import CEMSolver, GoalMSE, ShootingCostEvaluator

compat.install()  # The reference's models, on this package's data and planning.

from stable_worldmodel.wm.lewm import LeWM  # noqa: E402
from stable_worldmodel.wm.lewm.module import Embedder, Predictor  # noqa: E402
from stable_worldmodel.wm.loss import SIGReg  # noqa: E402

HISTORY, BLOCK, ACTION = 3, 5, 2


class Encoder(torch.nn.Module):
    """Images ``(N, 3, H, W)`` as one token ``(N, 1, dim)``, as transformers return them."""

    def __init__(self, dim: int) -> None:
        super().__init__()
        sizes = [(3, 16), (16, 32), (32, 64)]
        layers = [layer for a, b in sizes for layer in (torch.nn.Conv2d(a, b, 3, 2, 1), torch.nn.GELU())]
        self.layers = torch.nn.Sequential(*layers, torch.nn.AdaptiveAvgPool2d(2), torch.nn.Flatten())
        self.head = torch.nn.Linear(64 * 4, dim)

    def forward(self, pixels: torch.Tensor, interpolate_pos_encoding: bool = False) -> Any:
        return SimpleNamespace(last_hidden_state=self.head(self.layers(pixels)).unsqueeze(1))


def make_model(dim: int) -> Any:
    predictor = Predictor(
        num_frames=HISTORY, depth=2, heads=4, mlp_dim=4 * dim, input_dim=dim, hidden_dim=dim, dim_head=32
    )
    return LeWM(Encoder(dim), predictor, Embedder(BLOCK * ACTION, BLOCK * ACTION, dim))


def standardized(images: torch.Tensor) -> torch.Tensor:
    """Pixels of 0 to 255 as numbers around 0."""
    return images.float() / 127.5 - 1


def train(model: Any, path: Path, scaler: ZScoreScaler, options: argparse.Namespace) -> list[float]:
    """Steps of AdamW on shuffled clips of a history and one frame more; the losses."""
    clips = swm.data.load_dataset(path, num_steps=HISTORY + 1, frameskip=BLOCK, keys_to_load=["pixels", "action"])
    loader = swm.data.Loader(clips, options.batch, seed=options.seed, drop_last=True)
    regularizer = SIGReg(knots=17, num_proj=256).to(options.device)
    optimizer = torch.optim.AdamW(model.parameters(), lr=3e-4, weight_decay=1e-3)
    losses: list[float] = []
    while len(losses) < options.steps:
        for batch in loader:
            actions = scaler.transform(batch["action"].reshape(-1, ACTION).numpy())
            actions = torch.as_tensor(actions, dtype=torch.float32).reshape(batch["action"].shape).nan_to_num()
            pixels = standardized(batch["pixels"].to(options.device))
            seen = model.encode({"pixels": pixels, "action": actions.to(options.device)})
            predicted = model.predict(seen["emb"][:, :HISTORY], seen["act_emb"][:, :HISTORY])
            loss = (predicted - seen["emb"][:, 1:]).pow(2).mean()
            loss = loss + 0.09 * regularizer(seen["emb"].transpose(0, 1))
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses.append(loss.item())
            if len(losses) == options.steps:
                break
    return losses


def main(arguments: list[str] | None = None) -> tuple[list[float], Any]:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dataset", "--data", type=Path, default=Path("lewm.h5"), help="made if it does not exist")
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--image", type=int, default=64)
    parser.add_argument("--dim", type=int, default=64)
    parser.add_argument("--samples", type=int, default=300)
    parser.add_argument("--eval", type=int, default=8, help="episodes to plan in")
    parser.add_argument("--budget", type=int, default=50, help="steps of each")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    torch.manual_seed(options.seed)

    world = swm.World("swm/PushT-v1", 8, (options.image, options.image), max_episode_steps=options.budget)
    if not options.dataset.exists():
        world.set_policy("weak")
        world.collect(options.dataset, episodes=options.episodes, seed=options.seed)
    actions = swm.data.load_dataset(options.dataset).get_col_data("action")
    scaler = ZScoreScaler().fit(actions)

    model = make_model(options.dim).to(options.device)
    losses = train(model, options.dataset, scaler, options)
    model.eval().requires_grad_(False)

    cost = ShootingCostEvaluator(model, GoalMSE())
    samples, elites = options.samples, max(2, options.samples // 10)
    solver = CEMSolver(cost, 8, samples, n_steps=10, topk=elites, device=options.device)
    config = swm.PlanConfig(horizon=3, receding_horizon=2, history_len=HISTORY, action_block=BLOCK)
    world.set_policy(
        swm.WorldModelPolicy(
            solver,
            config,
            process={"action": scaler},
            transform={"pixels": standardized, "goal": standardized},
        )
    )
    return losses, world.evaluate(episodes=options.eval, seed=options.seed + 1)


if __name__ == "__main__":
    found, result = main()
    print(f"loss {found[0]:.3f} -> {found[-1]:.3f}")
    print(result)
