"""Exports a PyTorch world model to the folder that `swm eval --policy onnx:DIR` plans on.

A world model is two modules:

* ``encode(**fields) -> dict[str, Tensor]``: looks once per plan at the fields of one environment, each ``[1, ...]``: images
  as uint8 ``[1, H, W, 3]`` (``pixels`` and ``goal``), vectors as float32 (``proprio``). Normalize images inside.
* ``cost(actions, **encoded) -> Tensor``: the costs ``[S]`` of S candidate plans ``[S, H, D]``, from what was encoded. A
  candidate's cost must not depend on its neighbors: no batch norm in training mode.

Contract and example: docs/onnx.md. Needs torch, onnx, onnxscript.
"""

import json
from pathlib import Path

import torch

__all__ = ["export"]


def export(
    folder,
    encode,
    cost,
    fields,
    *,
    samples,
    horizon,
    dim,
    name,
    action_block,
    action_mean=None,
    action_std=None,
    gradient=True,
):
    """Writes model.json, encode.onnx, cost.onnx and (with `gradient`) cost_grad.onnx.

    `fields` are examples of what `encode` looks at, by name. `samples`, `horizon` and `dim` are the fixed sizes S, H and D
    of a batch of candidates; D is `action_block` times the action dim. `action_mean` and `action_std` are the
    statistics that actions were scaled with in training.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    encode, cost = encode.eval(), cost.eval()
    if (action_mean is None) != (action_std is None):
        raise ValueError("action_mean and action_std go together: give both, or neither")
    if dim % action_block:
        raise ValueError(f"dim {dim} is not a multiple of action_block {action_block}")
    with torch.no_grad():
        encoded = encode(**fields)
    if not isinstance(encoded, dict):
        raise TypeError("encode must return a dict of tensors, by the names under which cost takes them")
    actions = torch.zeros(samples, horizon, dim)
    with torch.no_grad():
        costs = cost(actions, **encoded)
    if tuple(costs.shape) != (samples,):
        raise ValueError(f"cost gave {tuple(costs.shape)} for {samples} candidates, and [S] is wanted")

    _write(folder / "encode.onnx", _Encode(encode, fields, encoded), tuple(fields.values()), list(fields), list(encoded))
    inputs = (actions, *encoded.values())
    names = ["actions", *encoded]
    _write(folder / "cost.onnx", _Cost(cost, encoded), inputs, names, ["cost"])
    if gradient:
        _write(folder / "cost_grad.onnx", _with_gradient(_Cost(cost, encoded), inputs), inputs, names, ["cost", "gradient"])

    pixels = fields.get("pixels")
    settings = {"name": name, "action_block": action_block}
    if action_mean is not None:
        scale = {"kind": "mean_std", "mean": _list(action_mean), "std": _list(action_std)}
        settings["action_scale"] = scale
    if pixels is not None:
        settings["image"] = pixels.shape[1]
    (folder / "model.json").write_text(json.dumps(settings, indent=2) + "\n")


class _Encode(torch.nn.Module):
    """Takes fields by position, gives tensors in order."""

    def __init__(self, encode, fields, encoded):
        super().__init__()
        self.encode, self.fields, self.encoded = encode, list(fields), list(encoded)

    def forward(self, *values):
        found = self.encode(**dict(zip(self.fields, values)))
        return tuple(found[name] for name in self.encoded)


class _Cost(torch.nn.Module):
    """Takes encoded tensors by position."""

    def __init__(self, cost, encoded):
        super().__init__()
        self.cost, self.encoded = cost, list(encoded)

    def forward(self, actions, *values):
        return self.cost(actions, **dict(zip(self.encoded, values)))


def _with_gradient(cost, inputs):
    """A graph of the costs and their derivatives; candidates do not interact, so the sum's derivative holds each one's."""
    from torch._decomp import core_aten_decompositions
    from torch.fx.experimental.proxy_tensor import make_fx
    from torch.nn.attention import SDPBackend, sdpa_kernel

    def both(actions, *values):
        def total(actions):
            costs = cost(actions, *values)
            return costs.sum(), costs

        gradient, (_, costs) = torch.func.grad_and_value(total, has_aux=True)(actions)
        return costs, gradient

    with sdpa_kernel(SDPBackend.MATH):
        return make_fx(both, decomposition_table=core_aten_decompositions())(*inputs)


def _write(path, module, inputs, input_names, output_names):
    program = torch.onnx.export(
        module, inputs, input_names=input_names, output_names=output_names, dynamo=True, optimize=False, verbose=False
    )
    program.save(str(path))


def _list(values):
    return [float(value) for value in values]
