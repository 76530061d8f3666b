"""Exports a tiny world model with stable_worldmodel_rs.export: a point that moves by the sum of its actions; cost: squared distance from the
goal. Usage: make_model.py FOLDER. Prints costs and gradients of two plans, to be compared."""

import json
import sys

import torch
from stable_worldmodel_rs.export import export_onnx

SPEED = 5.0


class Encode(torch.nn.Module):
    def forward(self, state, goal_state):
        return {"start": state / SPEED, "target": goal_state / SPEED}


class Cost(torch.nn.Module):
    def forward(self, actions, start, target):
        steps = actions.unflatten(2, (-1, 2)).sum(dim=(1, 2))
        return (start + steps - target).square().sum(dim=1)


fields = {"state": torch.zeros(1, 2), "goal_state": torch.zeros(1, 2)}
export_onnx(
    sys.argv[1],
    Encode(),
    Cost(),
    fields,
    samples=32,
    horizon=5,
    dim=10,
    name="point",
    action_block=5,
    action_mean=[0.0, 0.0],
    action_std=[1.0, 1.0],
)
encoded = Encode()(torch.tensor([[60.0, 110.0]]), torch.tensor([[90.0, 80.0]]))
plans = torch.linspace(-1, 1, 100).reshape(2, 5, 10).requires_grad_()
costs = Cost()(plans, **encoded)
costs.sum().backward()
print(json.dumps({"costs": costs.tolist(), "gradient": plans.grad.flatten().tolist()}))
