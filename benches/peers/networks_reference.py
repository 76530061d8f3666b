"""LeWM of the reference, timed: reads `{"case": …, "seconds": …}` per line, and answers with the CPU time of the quickest
call. Run by networks.py. The small network's encoder is not the reference's: it is written here as the preset says, in PyTorch's words."""

import json
import sys
import time
from types import SimpleNamespace

import torch
import torch.nn.functional as F
from stable_worldmodel.wm.lewm import LeWM
from stable_worldmodel.wm.lewm.module import MLP, Embedder, Predictor
from stable_worldmodel.wm.loss import SIGReg
from torch import nn
from transformers import ViTConfig, ViTModel

ACTION, HORIZON = 10, 5
SIZES = {
    "paper": dict(width=192, projector=2048, projections=1024, predictor=dict(depth=6, heads=16, dim_head=64, mlp_dim=2048)),
    "small": dict(width=128, projector=512, projections=256, predictor=dict(depth=4, heads=4, dim_head=32, mlp_dim=512)),
}


class Convolutions(nn.Module):
    """Convolutions that halve images of 64 pixels, then one linear layer. Answers as transformers' encoders do."""

    def __init__(self, width, channels=(3, 16, 32, 64, 128), side=64):
        super().__init__()
        layers = []
        for inputs, outputs in zip(channels, channels[1:]):
            size = 5 if inputs == 3 else 3
            layers += [nn.Conv2d(inputs, outputs, size, stride=2, padding=size // 2), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Flatten(), nn.Linear(channels[-1] * (side // 16) ** 2, width))

    def forward(self, pixels, interpolate_pos_encoding=True):
        return SimpleNamespace(last_hidden_state=self.layers(pixels)[:, None])


def lewm(preset):
    size = SIZES[preset]
    width, projector = size["width"], size["projector"]
    if preset == "small":
        encoder = Convolutions(width)
    else:
        encoder = ViTModel(
            ViTConfig(
                hidden_size=192, num_hidden_layers=12, num_attention_heads=3, intermediate_size=768, patch_size=14, image_size=224
            ),
            add_pooling_layer=False,
        )
    return LeWM(
        encoder=encoder,
        predictor=Predictor(num_frames=3, input_dim=width, hidden_dim=width, dropout=0.1, **size["predictor"]),
        action_encoder=Embedder(input_dim=ACTION, smoothed_dim=10, emb_dim=width),
        projector=MLP(width, projector, width, norm_fn=nn.BatchNorm1d),
        pred_proj=MLP(width, projector, width, norm_fn=nn.BatchNorm1d),
    )


def training(model, clips, side, projections):
    model.train()
    optimizer = torch.optim.AdamW(model.parameters(), 5e-5, weight_decay=1e-3)
    sigreg = SIGReg(num_proj=projections)
    pixels, action = torch.randn(clips, 4, 3, side, side), torch.randn(clips, 4, ACTION)

    def step():
        output = model.encode({"pixels": pixels, "action": action})
        states = output["emb"]
        predicted = model.predict(states[:, :3], output["act_emb"][:, :3])
        loss = F.mse_loss(predicted, states[:, 1:]) + 0.09 * sigreg(states.transpose(0, 1))
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()

    return step


def planning(model, width, samples, with_gradient):
    """From an encoded observation: what an iteration of a solver asks for."""
    model.eval()
    states, goal = torch.randn(1, samples, 1, width), torch.randn(width)
    plans = torch.randn(1, samples, HORIZON, ACTION, requires_grad=with_gradient)
    pixels = torch.zeros(1, samples, 1, 1)

    def costs():
        with torch.set_grad_enabled(with_gradient):
            end = model.rollout({"pixels": pixels, "emb": states}, plans)["predicted_emb"][:, :, -1]
            cost = (end - goal).square().sum(-1)
            if with_gradient:
                cost.sum().backward()

    return costs


def quickest(work, seconds):
    work()
    best, begin = float("inf"), time.process_time()
    while time.process_time() - begin < seconds:
        before = time.process_time()
        work()
        best = min(best, time.process_time() - before)
    return best


def main():
    torch.set_num_threads(int(sys.argv[1]))
    for line in sys.stdin:
        request = json.loads(line)
        kind, _, preset, count = request["case"].split(":")
        model, count, size = lewm(preset), int(count), SIZES[preset]
        if kind == "train":
            work = training(model, count, 64 if preset == "small" else 224, size["projections"])
        else:
            work = planning(model, size["width"], count, kind == "descend")
        print(json.dumps({"cpu_s": quickest(work, request["seconds"])}), flush=True)


if __name__ == "__main__":
    main()
