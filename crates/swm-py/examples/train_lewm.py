#!/usr/bin/env python3
"""Trains LeWM on clips of images, saves it as published checkpoints are, and plans with it.

    pip install torch stable_worldmodel_rs-*.whl
    python train_lewm.py --dataset tworoom.h5 --out lewm-tworoom                      # one GPU, or a CPU
    torchrun --nproc-per-node 4 train_lewm.py --dataset tworoom.h5 --out lewm-tworoom # four; --batch is that of each
    python train_lewm.py --size 32 --patch 8 --width 48 --depth 2 --steps 200         # small, for a CPU

The same command goes on where it was stopped, with more --steps too. --track trackio (or wandb, mlflow, tensorboard) follows it; metrics.jsonl has the
same. The losses are the paper's (arXiv 2603.19312): the error of the predicted next embedding, and SIGReg, which keeps embeddings from collapsing.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from pathlib import Path
from typing import Any

import torch
import torch.distributed as dist
import torch.nn.functional as F

import stable_worldmodel_rs as swm
from stable_worldmodel_rs.planning import CEMSolver
from stable_worldmodel_rs.wm import from_config
from stable_worldmodel_rs.wm.loss import SIGReg

HISTORY, BLOCK = 3, 5  # Frames that the model sees; actions from one frame to the next.


def config_of(options: argparse.Namespace, action: int) -> dict[str, Any]:
    """The model as ``config.json`` has it; with the default options that of the paper."""
    root, width = "stable_worldmodel.wm.lewm", options.width
    norm = {"_target_": "torch.nn.BatchNorm1d", "_partial_": True}
    mlp = {"_target_": f"{root}.module.MLP", "input_dim": width, "output_dim": width, "hidden_dim": 2048, "norm_fn": norm}
    encoder = {"size": "tiny", "patch_size": options.patch, "image_size": options.size, "pretrained": False, "use_mask_token": False}
    encoder |= {"hidden_size": width, "num_hidden_layers": options.depth, "num_attention_heads": 3, "intermediate_size": 4 * width}
    predictor = {"num_frames": HISTORY, "input_dim": width, "hidden_dim": width, "output_dim": width, "depth": max(1, options.depth // 2)}
    predictor |= {"heads": 16, "mlp_dim": 2048, "dim_head": 64, "dropout": 0.1, "emb_dropout": 0.0}
    return {
        "_target_": f"{root}.LeWM",
        "encoder": {"_target_": "stable_pretraining.backbone.utils.vit_hf", **encoder},
        "predictor": {"_target_": f"{root}.module.Predictor", **predictor},
        "action_encoder": {"_target_": f"{root}.module.Embedder", "input_dim": BLOCK * action, "emb_dim": width},
        "projector": mlp,
        "pred_proj": mlp,
    }


class Training(torch.nn.Module):
    """The model and its losses in one ``forward``, as several GPUs need it."""

    def __init__(self, model: torch.nn.Module, weight: float) -> None:
        super().__init__()
        self.model, self.sigreg, self.weight = model, SIGReg(), weight

    def forward(self, pixels: torch.Tensor, action: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Images ``(B, T, 3, H, W)``, bytes, and blocks ``(B, T, A)`` to the loss and its two parts."""
        seen = self.model.encode({"pixels": pixels, "action": action})
        states = seen["emb"]
        predicted = self.model.predict(states[:, :HISTORY], seen["act_emb"][:, :HISTORY])
        prediction = F.mse_loss(predicted.float(), states[:, 1:].float())
        normality = self.sigreg(states.transpose(0, 1))
        return prediction + self.weight * normality, prediction, normality


def learning_rate(options: argparse.Namespace, step: int) -> float:
    """Rises over the first twentieth of all steps, then falls to zero along a cosine."""
    warm = max(1, options.steps // 20)
    fallen = max(0, step - warm) / max(1, options.steps - warm)
    return options.lr * min(1.0, (step + 1) / warm) * 0.5 * (1 + math.cos(math.pi * fallen))


def train(options: argparse.Namespace, rank: int, ranks: int) -> tuple[torch.nn.Module, dict[str, Any], Any, swm.track.Tracker | None]:
    """The trained model, its config, the scaler of its actions, and of the first process where its metrics go."""
    device = torch.device(options.device)
    clips = swm.data.load_dataset(options.dataset, num_steps=HISTORY + 1, frameskip=BLOCK, keys_to_load=["pixels", "action"])
    loader = swm.data.Loader(clips, options.batch, seed=options.seed, drop_last=True, device=device, shard=(rank, ranks))
    actions = clips.get_col_data("action")
    scaler = swm.data.ZScoreScaler().fit(actions)
    config = config_of(options, actions.shape[-1])

    torch.manual_seed(options.seed)
    training = Training(from_config(config), options.sigreg).to(device)
    optimizer = torch.optim.AdamW(training.parameters(), lr=options.lr, weight_decay=1e-3)
    last, step = options.out / "training.state", 0
    if last.exists():
        stored = torch.load(last, map_location=device, weights_only=True)
        training.load_state_dict(stored["training"])
        optimizer.load_state_dict(stored["optimizer"])
        loader.load_state_dict(stored["loader"])
        step = stored["step"]
        print(f"goes on from step {step} of {last}")
    cards = [device.index or 0] if device.type == "cuda" else None
    # Of all tensors, the norms' running statistics included, those of rank 0 count.
    wrapped = torch.nn.parallel.DistributedDataParallel(training, device_ids=cards) if ranks > 1 else training

    def save() -> None:
        if rank == 0:
            state = {"training": training.state_dict(), "optimizer": optimizer.state_dict()}
            torch.save({**state, "loader": loader.state_dict(), "step": step}, last.with_suffix(".new"))
            os.replace(last.with_suffix(".new"), last)  # Whole, or not at all.

    settings = {name: value for name, value in vars(options).items() if name not in ("out", "track")}
    after = step if last.exists() else None
    tracker = swm.track.start(options.track, options.out, config={"model": config, **settings}, after=after) if rank == 0 else None

    begin, first = time.monotonic(), step
    while step < options.steps:
        for batch in loader:
            # Dropout and directions follow from the step alone: a run that was stopped goes on as if it had not been.
            torch.manual_seed((options.seed << 40) + (step << 10) + rank)
            blocks = scaler.transform(batch["action"].unflatten(-1, (BLOCK, -1))).flatten(-2).nan_to_num()
            with torch.autocast(device.type, torch.bfloat16, enabled=options.bf16):
                loss, prediction, normality = wrapped(batch["pixels"], blocks)
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(training.parameters(), 1.0)
            for group in optimizer.param_groups:
                group["lr"] = learning_rate(options, step)
            optimizer.step()
            step += 1
            if tracker is not None and (step % options.every == 0 or step == options.steps):
                rate = (step - first) / (time.monotonic() - begin)
                parts = f"loss {loss.item():.4f} = prediction {prediction.item():.4f} + {options.sigreg} * sigreg {normality.item():.4f}"
                print(f"step {step}: {parts}, {rate:.2f} steps/s, {rate * options.batch * ranks:.0f} clips/s", flush=True)
                tracker.log({"loss": loss, "prediction": prediction, "sigreg": normality, "lr": optimizer.param_groups[0]["lr"], "steps_per_s": rate}, step)
            if step % options.save == 0 or step == options.steps:
                save()
            if step == options.steps:
                break
    return training.model, config, scaler, tracker


def plan(options: argparse.Namespace, world: swm.World, scaler: Any) -> swm.EvaluationResult:
    """Episodes in which the saved model plans: CEM over blocks of actions, in the units of training."""
    model = swm.load_pretrained(options.out, device=options.device).requires_grad_(False)
    solver = CEMSolver(model, 8, options.samples, n_steps=10, topk=max(2, options.samples // 10), device=options.device)
    shape = swm.PlanConfig(horizon=5, receding_horizon=1, history_len=HISTORY, action_block=BLOCK)
    world.set_policy(swm.WorldModelPolicy(solver, shape, process={"action": scaler}))
    return world.evaluate(episodes=options.eval, seed=options.seed + 1, progress=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--env", default="swm/TwoRoom-v2")
    parser.add_argument("--dataset", type=Path, default=Path("tworoom.h5"), help="recorded if it does not exist")
    parser.add_argument("--episodes", type=int, default=200, help="to record")
    parser.add_argument("--out", type=Path, default=Path("lewm"), help="folder of the model, and of what a later run goes on from")
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--batch", type=int, default=128, help="clips of each process")
    parser.add_argument("--lr", type=float, default=5e-4)
    parser.add_argument("--sigreg", type=float, default=0.09, help="weight of SIGReg")
    parser.add_argument("--size", type=int, default=224, help="side of images")
    parser.add_argument("--patch", type=int, default=14)
    parser.add_argument("--width", type=int, default=192, help="of embeddings; a multiple of 3")
    parser.add_argument("--depth", type=int, default=12, help="blocks of the encoder; the predictor has half as many")
    parser.add_argument("--every", type=int, default=50, help="steps from one line to the next")
    parser.add_argument("--save", type=int, default=1000, help="steps from one save to the next")
    parser.add_argument("--samples", type=int, default=300, help="plans that are compared at a time")
    parser.add_argument("--eval", type=int, default=16, help="episodes to plan in; 0: none")
    parser.add_argument("--budget", type=int, default=100, help="steps of each")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--bf16", action=argparse.BooleanOptionalAction, default=torch.cuda.is_available())
    parser.add_argument("--track", nargs="*", default=[], choices=swm.track.TRACKERS, help="trackers that follow the training")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    rank, ranks = int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))
    if ranks > 1:  # Started by torchrun.
        if options.device == "cuda":
            options.device = f"cuda:{os.environ['LOCAL_RANK']}"
            torch.cuda.set_device(options.device)
        dist.init_process_group("nccl" if options.device.startswith("cuda") else "gloo")
    options.out.mkdir(parents=True, exist_ok=True)
    world = swm.World(options.env, 8, (options.size, options.size), max_episode_steps=options.budget) if rank == 0 else None
    if world is not None and not options.dataset.exists():
        world.set_policy("noisy-expert")
        world.collect(options.dataset, episodes=options.episodes, seed=options.seed)
    if ranks > 1:
        dist.barrier()

    model, config, scaler, tracker = train(options, rank, ranks)
    if world is not None and tracker is not None:
        swm.save_pretrained(model, options.out, config)
        print(f"{options.out}: the model; `swm import {options.out} --env {options.env} --dataset {options.dataset} --out RUN` makes a run of it")
        if options.eval:
            result = plan(options, world, scaler)
            tracker.evaluation(result, step=options.steps)
            print(result)
        tracker.finish()
    if ranks > 1:
        dist.destroy_process_group()


if __name__ == "__main__":
    main()
