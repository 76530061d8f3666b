"""What a cost returned, compared with what solvers take: shapes by the letters of the field, what was given, and the fix.

B are the environments that are planned for, S the candidates of each, H the blocks of a plan, A the values of a block, C constraints.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, cast

import numpy as np

from ..._arrays import Array, is_array, is_module, is_tensor
from ._errors import PlanAssertionError

__all__ = ["as_array", "check_returned", "check_tensor", "explained", "given", "history_of"]

# Attributes by which models say how many frames they take.
HISTORY = ("history_len", "history_size", "num_hist")


def given(value: Any) -> str:
    """A value by its kind, shape, type and device: ``torch.Tensor [1, 8] float32 on cpu``."""
    if is_tensor(value):
        return f"a tensor {list(value.shape)} of {str(value.dtype).removeprefix('torch.')} on {value.device}"
    if is_array(value):
        return f"an array {list(value.shape)} of {value.dtype}"
    if value is None:
        return "None"
    if isinstance(value, Mapping):
        return f"a dict with {', '.join(map(str, cast('Mapping[Any, Any]', value)))}"
    if isinstance(value, (list, tuple)):
        parts = cast("list[Any]", value)
        return f"a {_kind(value)} of {len(parts)}" + (f", the first of them {given(parts[0])}" if parts else "")
    return f"{_kind(value)} {value!r}" if isinstance(value, (bool, int, float, str)) else _kind(value)


def _kind(value: object) -> str:
    return type(value).__name__


def _wanted(method: str, rows: int, samples: int) -> str:
    if method == "get_cost":
        return f"costs [B, S] = [{rows}, {samples}], one for each of the B environments and S candidates"
    return f"constraints [B, S, C] = [{rows}, {samples}, C], at most 0 where they are kept"


def check_tensor(cost: Any, method: str, values: Any, rows: int, samples: int, is_shape: Callable[[Any], bool]) -> None:
    """Refuses what is no tensor of torch with data.

    Raises:
        PlanAssertionError: It names what was returned, what is taken, and the fix.
    """
    if is_tensor(values) and values.device.type != "meta":
        return
    if values is None:
        fix = "end the method with `return`"
    elif is_tensor(values):
        fix = "make the model on a device with data: `model.to_empty(device='cpu')` and load its weights"
    elif is_array(values):
        fix = 'return torch.from_numpy(values), or set `array_api = "numpy"` on the cost to be given arrays'
    elif isinstance(values, Mapping):
        fix = "return the value of the key that holds the costs"
    elif isinstance(values, (list, tuple)):
        first: Any = values[0] if values else None  # pyright: ignore[reportUnknownVariableType]
        fix = "return its first part alone" if is_shape(first) else "return one tensor: torch.stack(values) of tensors, torch.tensor(values) of numbers"
    else:
        fix = "return a tensor with a cost per candidate, not one number of all: sum over H and A alone"
    raise PlanAssertionError(f"{type(cost).__name__}.{method} returned {given(values)}; expected a torch.Tensor of {_wanted(method, rows, samples)}: {fix}")


def check_returned(cost: Any, method: str, values: Any, rows: int, samples: int) -> None:
    """Refuses costs ``[B, S]`` or constraints ``[B, S, C]`` of another shape, and those that are no real numbers.

    Raises:
        PlanAssertionError: It names what was returned, what is taken, and the fix.
    """
    shape: tuple[int, ...] = tuple(values.shape)
    ndim = 2 if method == "get_cost" else 3
    dtype = str(values.dtype)
    told = f"{type(cost).__name__}.{method} returned {given(values)}; expected {_wanted(method, rows, samples)}"
    if "complex" in dtype or getattr(values.dtype, "kind", "f") in "OSUMmV":
        fix = "return its real part or its absolute value" if "complex" in dtype else "return an array of numbers"
        raise PlanAssertionError(f"{told}: return real numbers: {fix}")
    if len(shape) == ndim and shape[:2] == (rows, samples):
        return
    raise PlanAssertionError(f"{told}: {_fix(shape, rows, samples, ndim)}")


def _fix(shape: tuple[int, ...], rows: int, samples: int, ndim: int) -> str:
    """How values of a shape become ``[B, S]`` or ``[B, S, C]``."""
    name = "costs" if ndim == 2 else "constraints"
    if ndim == 3 and shape == (rows, samples):
        return "constraints.unsqueeze(-1) of a single one"
    if shape == ():
        return "reduce over H and A alone, such as (…).mean((-2, -1)), not over all candidates"
    if shape == (*(rows, samples), *([1] * (len(shape) - 2))) and len(shape) > 2:
        return f"return {name}.squeeze(-1)" if len(shape) == 3 else f"return {name}.reshape({rows}, {samples})"
    if len(shape) > ndim and shape[:2] == (rows, samples):
        return f"reduce over all axes behind S, such as {name}.flatten(2).sum(-1)"
    if shape == (rows * samples,) and rows > 1:
        return f"return {name}.reshape({rows}, {samples}): candidates.shape[:2]"
    if shape == (samples,):
        return f"keep the axis B: {name}[None] of one environment, or reduce candidates [B, S, H, A] over their last two axes"
    if shape == (rows,) and rows != samples:
        return "one for each candidate, too: reduce candidates [B, S, H, A] over their last two axes alone"
    if shape == (samples, rows) and rows != samples:
        return f"return {name}.T"
    return "reduce candidates [B, S, H, A] over their last two axes alone"


def as_array(cost: Any, method: str, values: Any, rows: int, samples: int) -> Array:
    """What a NumPy cost returned, as an array.

    Raises:
        PlanAssertionError: It is none.
    """
    if values is None:
        raise PlanAssertionError(f"{type(cost).__name__}.{method} returned None; expected {_wanted(method, rows, samples)}: end the method with `return`")
    try:
        return np.asarray(values.detach().cpu() if is_tensor(values) else values)
    except (TypeError, ValueError, NotImplementedError) as error:
        raise PlanAssertionError(
            f"{type(cost).__name__}.{method} returned {given(values)}, of which NumPy makes no array ({error}); expected {_wanted(method, rows, samples)}"
        ) from error


# Columns that few models read, and how many of the others a message names.
_LEFT_OUT = ("variation.", "_", "id", "seed", "step_idx", "terminated", "truncated", "reward")
_MOST_COLUMNS = 12

# What torch says, and what it means where a solver called.
_HINTS: tuple[tuple[tuple[str, ...], str], ...] = (
    (
        ("Can't call numpy() on Tensor that requires grad",),
        "{solver} differentiates get_cost, which must stay within torch from the candidates to the costs: use functions of torch in the place "
        "of NumPy's, or a sampling solver such as CEMSolver",
    ),
    (
        ("does not require grad and does not have a grad_fn",),
        "get_cost is called without gradients: leave backward() and autograd.grad out of it, or plan with a solver that follows the gradient "
        "of the costs, such as GradientSolver",
    ),
    (("a leaf Variable that requires grad", "Inplace update to inference tensor", "is a view and is being modified inplace"),
     "get_cost changes a tensor that it was given; change a copy: candidates.clone()"),
    (("Inference tensors cannot be saved for backward",), "get_cost is called in torch.inference_mode(); give the model x.clone() where it needs gradients of its own"),
    (("same dtype", "expected scalar type", "should be the same", "expected m1 and m2 to have the same dtype"),
     "cast what the model is given to the type of its parameters: x.to(next(self.parameters()).dtype)"),
    (("on the same device", "same device"), "give the solver the device of the model, {solver}(…, device=…), or move the model: model.to(…)"),
    (("out of memory", "can't allocate memory"), "give {solver} a smaller batch_size (environments at once) or num_samples"),
)


@contextmanager
def explained(solver: Any, method: str, info: Mapping[str, Any], candidates: Any) -> Generator[None]:
    """Adds to an error within a cost what the solver gave it, and what that error means here. The error stays as it is."""
    try:
        yield
    except PlanAssertionError:
        raise
    except Exception as error:
        if hasattr(error, "add_note"):
            error.add_note(_explanation(solver, method, info, candidates, str(error)))
        raise


def _explanation(solver: Any, method: str, info: Mapping[str, Any], candidates: Any, text: str) -> str:
    cost, name = solver.cost, type(solver).__name__
    shown = {key: _short(value) for key, value in info.items() if (is_tensor(value) or is_array(value)) and not key.startswith(_LEFT_OUT)}
    columns = ", ".join(f"{key} {value}" for key, value in list(shown.items())[:_MOST_COLUMNS]) + (", …" if len(shown) > _MOST_COLUMNS else "")
    where = f" on {candidates.device}" if is_tensor(candidates) else ""
    parts = [
        f"{name} called {type(cost).__name__}.{method} with candidates [B, S, H, A] = {_short(candidates)}{where}, and infos [B, S, …]: {columns}"
    ]
    if is_module(cost) and (first := next(iter(cost.parameters()), None)) is not None:
        parts.append(f"The model's parameters are {str(first.dtype).removeprefix('torch.')} on {first.device}")
    hint = next((hint for words, hint in _HINTS if any(word in text for word in words)), None)
    if hint is not None:
        parts.append(hint.format(solver=name))
    if (frames := history_of(cost)) is not None:
        given_frames = getattr(getattr(solver, "_config", None), "history_len", 1)
        parts.append(
            f"The model has {frames[0]}={frames[1]}, and PlanConfig(history_len={given_frames}) gives it up to {given_frames} frames (T); an episode that "
            "has just begun has one"
        )
    return ". ".join(parts)


def _short(value: Any) -> str:
    return f"{list(value.shape)} {str(value.dtype).removeprefix('torch.')}"


def history_of(cost: Any, names: Sequence[str] = HISTORY) -> tuple[str, int] | None:
    """The attribute of a cost or its model that names how many frames it takes, if that is more than one."""
    for owner in (cost, getattr(cost, "model", None)):
        for name in names:
            value = getattr(owner, name, None)
            if isinstance(value, int) and not isinstance(value, bool) and value > 1:
                return name, value
    return None
