"""A TD-MPC2 of images whose weights are generated, so that only its outputs are stored. The reference's outputs were written by

    python tdmpc2_golden.py OUT      # with stable-worldmodel 0.1.1, torch 2.15.0
"""

from __future__ import annotations

import json
import random
import sys
from pathlib import Path
from typing import Any

import numpy as np

IMAGE, ACTION, STATE, HORIZON = 40, 2, 6, 3
CONFIG: dict[str, Any] = {
    "_target_": "stable_worldmodel.wm.tdmpc2.TDMPC2",
    "_recursive_": False,
    "cfg": {
        "image_size": IMAGE,
        "wm": {
            **{"horizon": HORIZON, "mlp_dim": 16, "enc_dim": 16, "simnorm_dim": 8, "num_q": 3, "rho": 0.5, "tau": 0.01, "num_bins": 51},
            **{"consistency_coef": 20.0, "reward_coef": 0.1, "value_coef": 0.1, "entropy_coef": 1e-4, "discount": 0.99},
            **{"uncertainty_penalty": 0.5, "vmin": -6, "vmax": 2, "encoding": {"pixels": 16, "state": 8}},
        },
        "action_dim": ACTION,
        "extra_dims": {"action": ACTION, "state": STATE},
    },
}
MEAN, STD = np.float32([0.485, 0.456, 0.406]), np.float32([0.229, 0.224, 0.225])


def weights(shapes: dict[str, tuple[int, ...]]) -> dict[str, Any]:
    """Tensors by name: normal values by a generator whose stream NumPy keeps."""
    stream = np.random.RandomState(7)
    found: dict[str, Any] = {}
    for name in sorted(shapes):
        shape = shapes[name]
        noise = stream.standard_normal(shape)
        if name == "scale.value":
            found[name] = np.full(shape, 3.5)
        elif len(shape) > 1:
            found[name] = noise * 1.3 / np.prod(shape[1:]) ** 0.5
        else:
            found[name] = 1 + 0.2 * noise if name.endswith("weight") else 0.3 * noise
    return {name: values.astype(np.float32) for name, values in found.items()}


def inputs() -> dict[str, Any]:
    stream = np.random.RandomState(8)
    return {
        "pixels": stream.randint(0, 256, (2, IMAGE, IMAGE, 3)).astype(np.uint8),
        "state": stream.standard_normal((2, STATE)).astype(np.float32),
        "candidates": stream.uniform(-1, 1, (4, HORIZON, ACTION)).astype(np.float32),
    }


def batch() -> dict[str, Any]:
    """Clips of a training step: images as the reference takes them, normalized."""
    stream = np.random.RandomState(9)
    pixels = stream.randint(0, 256, (2, HORIZON + 1, IMAGE, IMAGE, 3)).astype(np.uint8)
    return {
        "pixels": np.moveaxis((pixels.astype(np.float32) / 255 - MEAN) / STD, -1, -3),
        "state": stream.standard_normal((2, HORIZON + 1, STATE)).astype(np.float32),
        "action": stream.uniform(-1, 1, (2, HORIZON + 1, ACTION)).astype(np.float32),
        "reward": stream.standard_normal((2, HORIZON + 1)).astype(np.float32),
    }


def outputs(model: Any, forward: Any, cfg: Any) -> dict[str, Any]:
    """What a model with these weights gives; the losses and what they change, in evaluation mode, last."""
    import torch

    data = inputs()
    pixels = torch.from_numpy(np.moveaxis((data["pixels"].astype(np.float32) / 255 - MEAN) / STD, -1, -3).copy())
    seen = {"pixels": pixels, "state": torch.from_numpy(data["state"])}
    candidates = torch.from_numpy(data["candidates"])
    found: dict[str, Any] = {}
    with torch.no_grad():
        z = model.encode(seen)
        found["latents"] = z
        found["prior"] = torch.tanh(model.pi(z).chunk(2, dim=-1)[0])
        now, steps = z[:1].expand(4, -1), []
        for step in range(HORIZON):
            now = model(now, candidates[:, step])[0]
            steps.append(now)
        found["rollout"] = torch.stack(steps, dim=1)
        found["cost"] = model.get_cost({key: value[:1] for key, value in seen.items()}, candidates[None])[0]
        torch.manual_seed(3)
        found["actions"] = model.get_action(seen, horizon=2)
        torch.manual_seed(3)
        found["after"] = model.get_action(seen, horizon=2, prefix_actions=candidates[:2, :1])

    class Step:
        logged: dict[str, Any] = {}

        def __init__(self) -> None:
            self.model = model

        def log_dict(self, values: dict[str, Any], **_: Any) -> None:
            self.logged = values

    torch.manual_seed(4)
    random.seed(5)
    step = Step()
    clips = {key: torch.from_numpy(np.ascontiguousarray(value)) for key, value in batch().items()}
    forward(step, clips, "train", cfg)["loss"].backward()
    found |= {f"losses.{name.removeprefix('train/')}": value.detach() for name, value in step.logged.items()}
    found["gradients"] = torch.stack([value.grad.norm() for name, value in sorted(model.named_parameters()) if value.grad is not None])
    found["target"] = model.target_qs[0][2].weight.detach()[0]
    found["scale"] = model.scale.value
    return {name: value.detach().numpy() for name, value in found.items()}


if __name__ == "__main__":
    import torch
    from omegaconf import OmegaConf
    from stable_worldmodel.wm.tdmpc2 import TDMPC2, tdmpc2_forward

    cfg = OmegaConf.create(CONFIG["cfg"])
    model = TDMPC2(cfg).eval()
    state = model.state_dict()
    model.load_state_dict({name: torch.from_numpy(value) for name, value in weights({name: tuple(value.shape) for name, value in state.items()}).items()})
    found = outputs(model, tdmpc2_forward, cfg)
    out = {name: {"shape": list(value.shape), "values": [float(f"{one:.9g}") for one in value.reshape(-1).tolist()]} for name, value in found.items()}
    out["names"] = sorted(state)
    Path(sys.argv[1]).write_text(json.dumps(out, separators=(",", ":")) + "\n")
