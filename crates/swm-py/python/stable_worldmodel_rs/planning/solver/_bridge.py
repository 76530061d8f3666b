"""Between the Rust solvers and a cost in Python: arrays or tensors in, arrays out, and clear words for what does not fit.

Rust calls the methods of a bridge on the thread that called ``solve``. Every array of candidates is new and belongs to
Python, so costs may keep them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np

from ..._arrays import Array, is_array, is_tensor
from ...protocols import Constrainable
from ._checks import as_array, check_returned, check_tensor, explained, given
from ._errors import PlanAssertionError

if TYPE_CHECKING:
    import torch

    from ._base import BaseSolver

__all__ = ["Bridge", "NumpyBridge", "TorchBridge", "rows_of", "take_rows"]


def rows_of(info: dict[str, Any], otherwise: int) -> int:
    """B: the length of the first array of ``info``; ``otherwise`` where it has none."""
    for value in info.values():
        if is_rows(value):
            return len(value)
    return otherwise


def is_rows(value: Any) -> bool:
    """Whether ``value`` has a row per environment: an array, a tensor or a list, but no scalar."""
    return isinstance(value, list) or ((is_tensor(value) or is_array(value)) and value.ndim > 0)


def take_rows(info: dict[str, Any], rows: slice | Sequence[int]) -> dict[str, Any]:
    """The chosen rows of every array and list of ``info``; other values as they are."""
    index = range(rows.start, rows.stop) if isinstance(rows, slice) else rows
    taken: dict[str, Any] = {}
    for key, value in info.items():
        if not is_rows(value):
            taken[key] = value
        else:
            taken[key] = [value[i] for i in index] if isinstance(value, list) else value[rows]
    return taken


class Iteration(Protocol):
    """What is done with an iteration that is shown to callbacks."""

    def __call__(
        self,
        step: int,
        candidates: Array,
        costs: Array,
        mean: Array | None,
        std: Array | None,
        gradient: Array | None,
    ) -> None: ...


class Bridge:
    """The parts that costs on arrays and on tensors share. One bridge serves one solve of one chunk of rows."""

    def __init__(self, solver: BaseSolver, info: dict[str, Any], rows: int, show: Iteration) -> None:
        self.solver = solver
        self.cost: Any = solver.cost
        self.info = info
        self.rows = rows
        self.iteration = show
        self.violation = 0.0
        self._expanded: dict[int, dict[str, Any]] = {}

    def infos(self, samples: int) -> dict[str, Any]:
        """``info`` with a candidate axis, ``(b, S, ...)``: one dict per solve, so that a cost may keep things in it."""
        if samples not in self._expanded:
            self._expanded[samples] = {key: self.expand(value, samples) for key, value in self.info.items()}
        return self._expanded[samples]

    def expand(self, value: Any, samples: int) -> Any:
        """One value with a candidate axis, without a copy."""
        if is_array(value) and value.ndim > 0:
            shape = (value.shape[0], samples, *value.shape[1:])
            return np.broadcast_to(value[:, None], shape)
        return value

    def check(self, values: Any, samples: int, method: str) -> None:
        """Refuses costs and constraints of another shape, and those that are no real numbers."""
        check_returned(self.cost, method, values, self.rows, samples)

    def record_violation(self, values: Array) -> None:
        """Keeps the mean violation of the constraints, for the result."""
        self.violation = float(np.maximum(values, 0.0).mean()) if values.size else 0.0

    def count_constraints(self, candidates: Array) -> int:
        """C, by asking the cost once; 0 for a cost without constraints."""
        if not isinstance(self.cost, Constrainable):
            return 0
        _, values = self.constrain(candidates, False)
        return values.shape[2]

    def evaluate(self, candidates: Array) -> Array:
        """Costs ``(b, S)`` f64 of ``(b, S, H, D)`` f32."""
        raise NotImplementedError

    def differentiate(self, candidates: Array) -> tuple[Array, Array]:
        """Costs, and their derivative ``(b, S, H, D)`` f32."""
        raise NotImplementedError

    def constrain(self, candidates: Array, differentiable: bool) -> tuple[Array, Array]:
        """Costs, and constraints ``(b, S, C)`` f64. If ``differentiable``, :meth:`pull_back` follows."""
        raise NotImplementedError

    def pull_back(self, weights: Array) -> Array:
        """The derivative ``(b, S, H, D)`` of costs + weights × constraints; weights are flat."""
        raise NotImplementedError


class NumpyBridge(Bridge):
    """For costs with ``array_api = "numpy"``."""

    def ask(self, method: str, candidates: Array) -> Array:
        """Calls ``get_cost`` or ``get_constraints``, and checks what comes back."""
        samples = candidates.shape[1]
        infos = self.infos(samples)
        with explained(self.solver, method, infos, candidates):
            returned = getattr(self.cost, method)(infos, candidates)
        values = as_array(self.cost, method, returned, self.rows, samples)
        self.check(values, samples, method)
        return np.ascontiguousarray(values, np.float64)

    def evaluate(self, candidates: Array) -> Array:
        return self.ask("get_cost", candidates)

    def differentiate(self, candidates: Array) -> tuple[Array, Array]:
        samples = candidates.shape[1]
        method = getattr(self.cost, "get_cost_and_gradient", None)
        if method is None:
            raise PlanAssertionError(
                f"{type(self.solver).__name__} needs gradients, and {type(self.cost).__name__} is a NumPy cost without "
                "`get_cost_and_gradient`; add that method, return torch tensors instead, or use a sampling solver such "
                "as CEMSolver"
            )
        with explained(self.solver, "get_cost_and_gradient", self.infos(samples), candidates):
            returned = method(self.infos(samples), candidates)
        if not isinstance(returned, (tuple, list)) or len(cast("list[Any]", returned)) != 2:
            raise PlanAssertionError(
                f"{type(self.cost).__name__}.get_cost_and_gradient returned {given(returned)}; expected two arrays: costs [B, S] and their "
                "gradient [B, S, H, A]"
            )
        costs = as_array(self.cost, "get_cost", returned[0], self.rows, samples)
        gradient = as_array(self.cost, "get_cost_and_gradient", returned[1], self.rows, samples)
        self.check(costs, samples, "get_cost")
        if gradient.shape != candidates.shape:
            raise PlanAssertionError(
                f"{type(self.cost).__name__}.get_cost_and_gradient returned a gradient of shape {gradient.shape}; "
                f"return the shape of the candidates, {candidates.shape}"
            )
        return np.ascontiguousarray(costs, np.float64), np.ascontiguousarray(gradient, np.float32)

    def constrain(self, candidates: Array, differentiable: bool) -> tuple[Array, Array]:
        if differentiable:
            raise PlanAssertionError(
                f"{type(self.cost).__name__} is a NumPy cost, and gradients of constraints need torch; return torch "
                "tensors from get_cost and get_constraints"
            )
        costs = self.evaluate(candidates)
        values = self.ask("get_constraints", candidates)
        self.record_violation(values)
        return costs, values


class TorchBridge(Bridge):
    """For costs on torch tensors."""

    def __init__(self, solver: BaseSolver, info: dict[str, Any], rows: int, show: Iteration) -> None:
        import torch

        super().__init__(solver, info, rows, show)
        self._torch = torch
        self._device = torch.device(solver.device)
        self._dtype: torch.dtype = solver.dtype
        self._shared = (torch.float32, torch.float64)
        self._is_plain = self._device.type == "cpu" and self._dtype == torch.float32
        self._graph: tuple[torch.Tensor, torch.Tensor, torch.Tensor] | None = None

    def expand(self, value: Any, samples: int) -> Any:
        if not is_tensor(value) or value.ndim == 0:
            return super().expand(value, samples)
        value = value.to(device=self._device, dtype=self._dtype if value.is_floating_point() else None)
        return value.unsqueeze(1).expand(value.shape[0], samples, *value.shape[1:])

    def tensor(self, candidates: Array) -> torch.Tensor:
        """Candidates where and as the cost wants them."""
        tensor: torch.Tensor = self._torch.from_numpy(candidates)  # pyright: ignore[reportUnknownMemberType]
        return tensor if self._is_plain else tensor.to(device=self._device, dtype=self._dtype)

    def ask(self, name: str, info: dict[str, Any], candidates: torch.Tensor) -> torch.Tensor:
        """Calls ``get_cost`` or ``get_constraints``, and checks what comes back."""
        with explained(self.solver, name, info, candidates):
            values = getattr(self.cost, name)(info, candidates)
        samples = candidates.shape[1]
        check_tensor(self.cost, name, values, self.rows, samples, lambda part: is_tensor(part) and tuple(part.shape[:2]) == (self.rows, samples))
        self.check(values, samples, name)
        return values

    def array(self, values: torch.Tensor, dtype: type[np.floating[Any]] = np.float64) -> Array:
        """A contiguous array of a tensor of any type on any device."""
        if values.requires_grad:
            values = values.detach()
        # NumPy has no bfloat16; of what it has, its own conversion is the quicker one.
        if values.dtype not in self._shared or not values.is_cpu:
            values = values.to(device="cpu", dtype=self._torch.float64)
        return np.ascontiguousarray(values.numpy(), dtype)

    def evaluate(self, candidates: Array) -> Array:
        info = self.infos(candidates.shape[1])
        if not self.solver.uses_gradient:  # The whole solve is in inference mode.
            return self.array(self.ask("get_cost", info, self.tensor(candidates)))
        with self._torch.no_grad():
            return self.array(self.ask("get_cost", info, self.tensor(candidates)))

    def leaf(self, candidates: Array) -> torch.Tensor:
        """Candidates that gradients are wanted of."""
        return self.tensor(candidates).detach().requires_grad_(True)

    def require_gradient(self, costs: torch.Tensor) -> None:
        """Refuses costs that were cut from the candidates."""
        if not costs.requires_grad:
            raise PlanAssertionError(
                f"{type(self.solver).__name__} needs gradients, and the costs of {type(self.cost).__name__} do not "
                "require any; remove `detach()` and `no_grad()` from get_cost, or use a sampling solver such as "
                "CEMSolver"
            )

    def gradient(self, total: torch.Tensor, leaf: torch.Tensor) -> torch.Tensor:
        """The derivative of a number by the candidates."""
        (gradient,) = self._torch.autograd.grad(total, leaf, allow_unused=True)
        if gradient is None:
            raise PlanAssertionError(
                f"{type(self.solver).__name__} needs gradients, and the costs of {type(self.cost).__name__} depend on its parameters and not "
                "on the candidates [B, S, H, A]; let get_cost use the candidates that it is given, without `detach()` or `.data`"
            )
        return gradient

    def differentiate(self, candidates: Array) -> tuple[Array, Array]:
        leaf = self.leaf(candidates)
        costs = self.ask("get_cost", self.infos(candidates.shape[1]), leaf)
        self.require_gradient(costs)
        return self.array(costs), self.array(self.gradient(costs.sum(), leaf), np.float32)

    def constrain(self, candidates: Array, differentiable: bool) -> tuple[Array, Array]:
        torch = self._torch
        tensor = self.leaf(candidates) if differentiable else self.tensor(candidates)
        # Both methods get a copy of the dict: what one keeps in it belongs to its own graph.
        info = self.infos(candidates.shape[1])
        with torch.set_grad_enabled(differentiable):
            costs = self.ask("get_cost", dict(info), tensor)
            values = self.ask("get_constraints", dict(info), tensor)
        if differentiable:
            self.require_gradient(costs)
            self._graph = (costs, values, tensor)
        array = self.array(values)
        self.record_violation(array)
        return self.array(costs), array

    def pull_back(self, weights: Array) -> Array:
        assert self._graph is not None, "constrain comes first"
        torch, (costs, values, leaf) = self._torch, self._graph
        self._graph = None
        weighted = torch.from_numpy(weights).reshape(values.shape).to(values) * values
        total = costs.sum() + weighted.sum() if values.requires_grad else costs.sum()
        return self.array(self.gradient(total, leaf), np.float32)
