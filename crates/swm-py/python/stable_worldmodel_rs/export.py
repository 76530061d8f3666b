"""Export of a PyTorch world model to the folder that ``swm eval --policy onnx:DIR`` plans with.

A world model is two modules:

* ``encode(**fields) -> dict[str, Tensor]`` runs once per plan on the fields of one environment, each ``(1, ...)``: images
  as uint8 ``(1, H, W, 3)`` (``pixels`` and ``goal``), vectors as float32 (``proprio``). Normalize images inside.
* ``cost(actions, **encoded) -> Tensor`` gives the costs ``(S,)`` of S candidate plans ``(S, H, D)``, from what was encoded.
  A candidate's cost must not depend on its neighbors: no batch norm in training mode.

Needs torch, onnx, onnxscript: ``pip install torch onnx onnxscript``.
"""

from __future__ import annotations

import json
import os
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from ._access import access_checked
from ._arrays import require_torch

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import torch

    from .world.manifests import AnyPath

__all__ = ["export_onnx"]

_NEED = "export_onnx takes PyTorch modules"


@access_checked
def export_onnx(
    folder: AnyPath,
    encode: torch.nn.Module,
    cost: torch.nn.Module,
    fields: Mapping[str, torch.Tensor],
    *,
    samples: int,
    horizon: int,
    dim: int,
    name: str,
    action_block: int,
    action_mean: Iterable[float] | None = None,
    action_std: Iterable[float] | None = None,
    gradient: bool = True,
    history: int = 1,
    history_keys: Sequence[str] = ("pixels",),
) -> None:
    """Write ``model.json``, ``encode.onnx``, ``cost.onnx`` and (with ``gradient``) ``cost_grad.onnx``.

    Either all of them are written, or none: until everything is exported, ``folder`` is left as it is. Then files of these
    names are replaced, and a ``cost_grad.onnx`` of an earlier export is removed where ``gradient`` is false.

    Args:
        folder: Where to; made if missing.
        encode: Module that runs once per plan.
        cost: Module that gives the costs of candidates.
        fields: Examples of what ``encode`` is given, by name, ``(1, ...)`` each.
        samples: S, candidates of a batch. The exported graphs have this size alone.
        horizon: H, blocks of a plan.
        dim: D, values of a block: ``action_block`` times the action dim.
        name: What the policy is called in results.
        action_block: Actions of a block.
        action_mean: Means by which actions were standardized in training.
        action_std: Their standard deviations.
        gradient: Whether to export derivatives, for solvers with gradients.
        history: T, frames that ``encode`` is given of each of ``history_keys``, ``(1, T, ...)``, ``action_block`` steps apart, the
            present one last; the blocks between them are its input ``action_history``, ``(1, T - 1, D)``, if it takes that. Young
            episodes have copies of their first frame and blocks of zeros in front.
        history_keys: What it is given so, with ``history`` above 1.

    Raises:
        ImportError: torch, onnx or onnxscript is not installed.
        NotADirectoryError: ``folder`` is a file.
        TypeError: ``encode`` gives no dict.
        ValueError: ``cost`` gives another shape than ``(S,)``, ``dim`` does not fit ``action_block``, or only one of
            ``action_mean`` and ``action_std`` is given.

    Example:
        See ``tests/onnx/make_model.py`` in the repository, and the page *Custom world models by ONNX*.
    """
    torch = require_torch(_NEED)
    encode, cost = encode.eval(), cost.eval()
    if (action_mean is None) != (action_std is None):
        raise ValueError("action_mean and action_std go together: give both, or neither")
    if dim % action_block:
        raise ValueError(f"dim {dim} is not a multiple of action_block {action_block}")
    keys = [key for key in history_keys if key in fields] if history > 1 else []
    if history < 1 or (history > 1 and not keys):
        raise ValueError(f"history={history} of {', '.join(history_keys)}: give 1 or more, and fields that have it")
    for key, frames in [*((key, history) for key in keys), ("action_history", history - 1)]:
        if key in fields and (fields[key].ndim < 3 or fields[key].shape[1] != frames):
            raise ValueError(f"{key} is {tuple(fields[key].shape)}; with history={history} it is (1, {frames}, ...)")
    with torch.no_grad():
        encoded = _named(encode(**fields))
    actions = torch.zeros(samples, horizon, dim)
    with torch.no_grad():
        costs: torch.Tensor = cost(actions, **encoded)
    if tuple(costs.shape) != (samples,):
        raise ValueError(f"cost gave {tuple(costs.shape)} for {samples} candidates, and ({samples},) is wanted")

    _require_onnx()
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(f"{folder} is a file; name a folder for the model")
    settings: dict[str, Any] = {"name": name, "action_block": action_block}
    if action_mean is not None and action_std is not None:
        settings["action_scale"] = {"kind": "mean_std", "mean": _floats(action_mean), "std": _floats(action_std)}
    if "pixels" in fields:
        settings["image"] = fields["pixels"].shape[-3]
    if history > 1:
        settings |= {"history": history, "history_fields": keys}
    # On the same disk, so that files are moved and not copied.
    near = next(parent for parent in folder.absolute().parents if parent.is_dir())
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=near) as name_of_draft:
        draft = Path(name_of_draft)
        examples = tuple(fields.values())
        encode = _by_position(encode, list(fields), list(encoded))
        _write(draft / "encode.onnx", encode, examples, list(fields), list(encoded))
        cost = _by_position(cost, list(encoded))
        inputs = (actions, *encoded.values())
        names = ["actions", *encoded]
        _write(draft / "cost.onnx", cost, inputs, names, ["cost"])
        if gradient:
            both = _with_gradient(cost, inputs)
            _write(draft / "cost_grad.onnx", both, inputs, names, ["cost", "gradient"])
        (draft / "model.json").write_text(json.dumps(settings, indent=2) + "\n")
        _move(draft, folder)


def _move(draft: Path, folder: Path) -> None:
    """Moves the files of a model into its folder, ``model.json`` last: without it, a folder is no model."""
    folder.mkdir(parents=True, exist_ok=True)
    files = sorted(draft.iterdir(), key=lambda file: file.name == "model.json")
    (folder / "model.json").unlink(missing_ok=True)
    (folder / "cost_grad.onnx").unlink(missing_ok=True)
    for file in files:
        os.replace(file, folder / file.name)


def _require_onnx() -> None:
    missing = [name for name in ("onnx", "onnxscript") if find_spec(name) is None]
    if missing:
        names = " ".join(missing)
        raise ImportError(f"export_onnx needs {' and '.join(missing)}; install with `pip install {names}`")


def _named(outputs: Any) -> dict[str, torch.Tensor]:
    """The outputs of ``encode``, which have to be a dict."""
    if not isinstance(outputs, dict):
        raise TypeError("encode must return a dict of tensors, by the names under which cost takes them")
    return cast("dict[str, torch.Tensor]", outputs)


def _by_position(module: torch.nn.Module, names: Sequence[str], outputs: Sequence[str] | None = None) -> torch.nn.Module:
    """``module`` with its last inputs, ``names``, given by position; of a dict, the values of ``outputs`` in order."""
    torch = require_torch(_NEED)

    class ByPosition(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()  # pyright: ignore[reportUnknownMemberType]  torch's
            self.module = module

        def forward(self, *values: torch.Tensor) -> Any:
            count = len(values) - len(names)
            found = self.module(*values[:count], **dict(zip(names, values[count:], strict=True)))
            return found if outputs is None else tuple(found[name] for name in outputs)

    return ByPosition()


def _with_gradient(cost: torch.nn.Module, inputs: tuple[torch.Tensor, ...]) -> torch.nn.Module:
    """A graph of the costs and their derivatives; candidates do not interact, so the sum's derivative holds each one's."""
    torch = require_torch(_NEED)
    from torch._decomp import core_aten_decompositions
    from torch.fx.experimental.proxy_tensor import make_fx
    from torch.nn.attention import SDPBackend, sdpa_kernel

    def both(actions: torch.Tensor, *values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        def total(actions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            costs = cost(actions, *values)
            return costs.sum(), costs

        gradient, (_, costs) = torch.func.grad_and_value(total, has_aux=True)(actions)
        return costs, gradient

    with sdpa_kernel(SDPBackend.MATH):
        table: Any = core_aten_decompositions()  # A dict, which torch's types do not say.
        return make_fx(both, decomposition_table=table)(*inputs)


def _attend(
    query: torch.Tensor,
    key: torch.Tensor,
    value: torch.Tensor,
    attn_mask: torch.Tensor | None = None,
    dropout_p: float = 0.0,
    is_causal: bool = False,
    **options: Any,
) -> Any:
    """Attention with the four dims that torch's exporter takes, from any number of them."""
    dims = query.ndim
    if dims == 4:
        return NotImplemented

    def four(tensor: torch.Tensor) -> torch.Tensor:
        return tensor.flatten(0, dims - 4) if dims > 4 else tensor.reshape(*(1,) * (4 - dims), *tensor.shape)

    if attn_mask is not None and attn_mask.ndim > 4:
        attn_mask = attn_mask.expand(*query.shape[:-3], *attn_mask.shape[-3:]).flatten(0, dims - 4)
    attend = require_torch(_NEED).ops.aten.scaled_dot_product_attention.default
    found = attend(four(query), four(key), four(value), attn_mask, dropout_p, is_causal, **options)
    return found.reshape(*query.shape[:-1], value.shape[-1])


def _program(module: torch.nn.Module, inputs: tuple[torch.Tensor, ...]) -> Any:
    """``module`` as torch exports it, with attention that the ONNX exporter takes."""
    torch = require_torch(_NEED)
    try:
        program = torch.export.export(module, inputs)
    except Exception:  # noqa: BLE001  Whatever it is: `torch.onnx.export` has other ways, and reports what it meets.
        return module
    return program.run_decompositions({torch.ops.aten.scaled_dot_product_attention.default: _attend})


def _write(
    path: Path,
    module: torch.nn.Module,
    inputs: tuple[torch.Tensor, ...],
    input_names: Sequence[str],
    output_names: Sequence[str],
) -> None:
    exported: Any = require_torch(_NEED).onnx.export(
        _program(module, inputs),
        inputs,
        input_names=input_names,
        output_names=output_names,
        dynamo=True,
        optimize=False,
        verbose=False,
    )
    exported.save(str(path))


def _floats(values: Iterable[float]) -> list[float]:
    return [float(value) for value in values]
