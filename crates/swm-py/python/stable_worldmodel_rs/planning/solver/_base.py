"""What all solvers share: their arguments, plans in and out, and the call of the Rust solver."""

from __future__ import annotations

import contextlib
import functools
import logging
import time
from dataclasses import Field, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from ..._arguments import device_of, request_text, whole_number
from ..._arrays import Array, is_array, is_tensor, require_torch
from ..._prepare import require_method
from ...protocols import Actionable
from ._bridge import Bridge, NumpyBridge, TorchBridge, rows_of, take_rows
from ._checks import history_of
from ._errors import PlanAssertionError
from ._mode import note_training_mode
from ._settings import as_setting, native_settings, native_solver, setting_of
from ._shown import FirstCandidates, Shown
from ._space import PlanSpace
from .utils import prepare_init_action

if TYPE_CHECKING:
    from collections.abc import Sequence

    import gymnasium as gym
    import torch

    from ..._swm import Solver as NativeSolver
    from .callbacks import Callback

__all__ = ["BaseSolver", "PlanKeys"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")


class PlanKeys(NamedTuple):
    """Which plan of which episode each row is: noise depends on this, not on the rows that are planned together."""

    slots: Sequence[int]
    """The environments, ``(B,)``: what solvers keep from plan to plan belongs to them."""
    seeds: Sequence[int]
    """The seeds of their episodes."""
    plans: Sequence[int]
    """How many plans each episode had before."""


class BaseSolver:
    """The base of all solvers: the search runs in Rust, the cost in Python, on the thread that calls.

    ``configure`` comes first, then any number of ``solve``. Noise is keyed by the seed, the episode, and the plan, so a
    plan is the same bits alone or among others, for any ``batch_size``.

    A solver is a dataclass, whose fields are its arguments in the reference's order. Those that the Rust solver knows, under
    the same name or that of ``KEYWORDS``, are its settings.
    """

    native_name: ClassVar[str]
    """The name of the Rust solver."""
    _asks_actor: ClassVar[bool] = True
    """Whether a model's own actions continue a warm start."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    cost: Any
    batch_size: int | None
    num_samples: int
    n_steps: int
    device: str | torch.device
    seed: int
    callbacks: Sequence[Callback] | None
    """A list as soon as the solver is made."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        made = cls.__dict__.get("__init__")
        if made is None:
            return

        @functools.wraps(made)
        def init(self: BaseSolver, *args: Any, **kwargs: Any) -> None:
            made(self, *args, **kwargs)
            if type(self).__init__ is init:
                self._check_settings()

        # As an assignment, it would be the type of `__init__` in all of them.
        type.__setattr__(cls, "__init__", init)

    def __post_init__(self) -> None:
        self._require_cost(self.cost)
        whole_number("seed", self.seed, least=-(1 << 63))
        if self.batch_size is not None and whole_number("batch_size", self.batch_size, least=-(1 << 62)) < 1:
            raise ValueError(f"batch_size must be >= 1 or None, got {self.batch_size}")
        self.callbacks = list(self.callbacks or ())
        self._configured = False
        self._action_space: gym.Space[Any] | None = None
        self._n_envs: int | None = None
        self._config: Any = None
        self._action_dim: int | None = None
        self._space: PlanSpace | None = None
        self._clips = False
        self._calls = 0
        self._memory: dict[int, Array] = {}
        self._solvers: dict[tuple[str, str], NativeSolver] = {}
        if not hasattr(type(self).__init__, "__wrapped__"):
            self._check_settings()

    def _check_settings(self) -> None:
        """Refuses wrong settings when all are there, and not when a long run begins to plan.

        That is at the end of ``__init__``: the one that the dataclass has, or that of a class of the user's own.
        """
        native_solver(self._key(), self._keywords())

    def _require_cost(self, cost: Any) -> None:
        """Refuses what has no cost. A solver for :class:`~stable_worldmodel_rs.MpcPolicy` may have none, or one in Rust."""
        if cost is None or getattr(cost, "is_native", False):
            return
        from ...compat import is_installed

        if is_installed():
            # Under the reference's name anything may be given, and is refused when it is asked for costs.
            return
        hint = (
            "a world model with encode and rollout becomes a cost by ShootingCostEvaluator(model, objective); the simulator "
            "itself is SimulatorCost(), for MpcPolicy"
        )
        needed = "get_cost(info_dict, candidates): costs (B, S) of candidates (B, S, H, D)"
        require_method(type(self).__name__, cost, "get_cost", needed, hint)

    def __repr__(self) -> str:
        settings = ", ".join(f"{name}={value}" for name, value in self.settings().items())
        return f"{type(self).__name__}({type(self.cost).__name__}, {settings}, seed={self.seed})"

    def __getstate__(self) -> dict[str, Any]:
        # The Rust solvers are made again where they are needed.
        return {**self.__dict__, "_solvers": {}}

    # The description of each solver.

    def settings(self) -> dict[str, Any]:
        """The settings of the Rust solver, in the order of its table: of its arguments, those that it knows."""
        given = {setting_of(one.name): as_setting(getattr(self, one.name), one.default) for one in fields(self)}
        return {name: given[name] for name in native_settings(self.native_name) if name in given and name != "seed"}

    def _keywords(self) -> dict[str, str]:
        """The keyword of each setting."""
        return {setting_of(one.name): one.name for one in fields(self)}

    def _evaluations(self) -> int:
        """How many evaluations without gradient are passed on to the cost."""
        return 1 << 62 if self.uses_gradient else self.n_steps

    @property
    def uses_gradient(self) -> bool:
        return False

    def _costs(self) -> str:
        """Which costs are returned: ``elite_mean``, of the last elites (of gradient solvers: of the ends), or ``cost``, of the plans."""
        return "cost" if self.settings().get("return_best") else "elite_mean"

    def _finish(self, results: list[dict[str, Any]], bridges: list[Bridge]) -> dict[str, Any]:
        """The result of ``solve`` but for ``actions``, from those of all chunks."""
        return {"costs": joined(results, self._costs()).tolist()}

    # What the reference has under the same names.

    def configure(self, *, action_space: gym.Space[Any], n_envs: int, config: Any) -> None:
        """Tells the solver what it plans for.

        Args:
            action_space: The batched space of actions, ``(n_envs, ...)``.
            n_envs: How many environments there are.
            config: A :class:`~stable_worldmodel_rs.policy.PlanConfig`. With its ``clip_actions``, the cost is given
                candidates as they are executed, within the bounds of the actions.
        """
        self._action_space = action_space
        self._n_envs = n_envs
        self._config = config
        self._space = PlanSpace.of(action_space, n_envs)
        self._action_dim = self._space.actions
        self._clips = bool(getattr(config, "clip_actions", True)) and not self._space.categories
        self._memory.clear()
        self._configured = True
        self._check_space(self._space)
        self._check_device()
        note_training_mode(self.cost)
        frames = history_of(self.cost, ("history_len",))
        if frames is not None and frames[1] > getattr(config, "history_len", 1):
            logger.warning(
                "%s has %s=%d, and PlanConfig(history_len=%d) gives it fewer frames (T); give PlanConfig(history_len=%d), or leave it if the "
                "model plans from fewer",
                type(self.cost).__name__,
                *frames,
                getattr(config, "history_len", 1),
                frames[1],
            )

    def _check_device(self) -> None:
        """Refuses a device that this torch does not have, before a long run begins to plan."""
        if str(self.device) == "cpu" or self.cost is None or self.array_api == "numpy":
            return
        try:
            device_of("device", self.device)
        except ValueError as error:
            raise PlanAssertionError(f"{type(self).__name__}: {error}") from None

    def set_bounds(self, low: Array, high: Array) -> None:
        """Tells the bounds of real actions in units of plans, ``(A,)`` each, where these are not the environment's."""
        self._space = replace(
            self._require_configured(), low=[float(value) for value in low], high=[float(value) for value in high]
        )

    def _check_space(self, space: PlanSpace) -> None:
        """Says early that the solver needs other actions."""
        if space.categories:
            logger.warning(
                "Action space is discrete, got %s. %s plans real numbers; use CategoricalCEMSolver or PGDSolver.",
                type(self._action_space).__name__,
                type(self).__name__,
            )

    @property
    def n_envs(self) -> int:
        """How many environments there are; None before ``configure``."""
        return self._n_envs  # type: ignore[return-value]

    @property
    def horizon(self) -> int:
        """H: blocks of a plan."""
        return self._config.horizon

    @property
    def action_dim(self) -> int:
        """D: values of a block, ``action_block`` actions."""
        return self._action_dim * self._config.action_block  # type: ignore[operator]

    @property
    def plans_integers(self) -> bool:
        """Whether actions are integers."""
        return bool(self._require_configured().categories)

    @property
    def array_api(self) -> str:
        """``"numpy"`` or ``"torch"``: what the cost is given, and what ``solve`` returns."""
        return "numpy" if getattr(self.cost, "array_api", None) == "numpy" else "torch"

    @property
    def dtype(self) -> torch.dtype:
        """The type of the cost's parameters; ``torch.float32`` for a cost without any. Candidates are cast to it."""
        torch = torch_of(self.cost)
        try:
            return next(self.cost.parameters()).dtype
        except (AttributeError, StopIteration, TypeError):
            return torch.float32

    def __call__(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """The same as :meth:`solve`."""
        return self.solve(*args, **kwargs)

    def solve(
        self, info_dict: dict[str, Any], init_action: Any = None, *, keys: PlanKeys | None = None
    ) -> dict[str, Any]:
        """Searches for the cheapest plan of every row of ``info_dict``.

        Args:
            info_dict: Observations, ``(B, ...)`` each; B may be fewer than ``n_envs``. The cost gets them with a
                candidate axis, ``(b, S, ...)``, expanded without a copy, in chunks of b = ``batch_size`` rows.
            init_action: Where the search begins, ``(B, t, D)`` with t up to H; None begins at zeros.
            keys: Which plan of which episode each row is. Without it, rows are told apart by the column ``seed`` of
                ``info_dict``, or by their index, and plans by the number of calls.

        Returns:
            ``actions``, ``(B, H, D)`` float32 on the CPU (integers: ``(B, H, action_block × A)`` int64), ``costs``, a
            list of B floats, and more of each solver; where ``actions`` were clipped, ``unclipped``, what the search
            found. Tensors, or arrays for a cost with ``array_api = "numpy"``.
        """
        begun = time.perf_counter()
        space = self._require_configured()
        total = rows_of(info_dict, self.n_envs)
        if total == 0:
            raise PlanAssertionError(f"{type(self).__name__} was given no rows to plan for; leave the call out")
        if init_action is not None:
            init_action = self._checked_start(init_action, total)
        keys = self._keys(info_dict, total) if keys is None else keys
        for callback in self.callbacks or ():
            callback.reset()
        results: list[dict[str, Any]] = []
        bridges: list[Bridge] = []
        batch = self.batch_size or total
        for start in range(0, total, batch):
            rows = slice(start, min(start + batch, total))
            info = take_rows(info_dict, rows)
            initial = self._initial(info, None if init_action is None else init_action[rows], rows.stop - rows.start)
            result, bridge = self._solve_chunk(info, initial, _rows(keys, rows), space)
            results.append(result)
            bridges.append(bridge)
        self._calls += 1
        outputs = self._finish(results, bridges)
        plans = joined(results, "actions")
        executed = space.clip(plans) if self._clips else plans
        if not np.array_equal(executed, plans):
            outputs["unclipped"] = self.as_given(plans)
        outputs["actions"] = self._actions(executed, space)
        if self.callbacks:
            for callback in self.callbacks or ():
                callback.end_solve()
            outputs["callbacks"] = {callback.output_key: callback.history for callback in self.callbacks}
        logger.debug("%s planned for %d rows in %.4f s", type(self).__name__, total, time.perf_counter() - begun)
        return outputs

    def show(self, state: dict[str, Any]) -> None:
        """One iteration, for the callbacks."""
        for callback in self.callbacks or ():
            callback(**state)

    # The call of the Rust solver.

    def _key(self, **changes: Any) -> tuple[str, str]:
        """Name and settings of the Rust solver."""
        settings = {**self.settings(), "seed": self.seed & 0xFFFF_FFFF, **changes}
        return self.native_name, request_text(settings, self._keywords())

    def _solver(self, **changes: Any) -> NativeSolver:
        key = self._key(**changes)
        if key not in self._solvers:
            self._solvers[key] = native_solver(key, self._keywords())
        return self._solvers[key]

    def _bridge(self, info: dict[str, Any], rows: int, initial: Array) -> Bridge:
        show = Shown(self, initial)
        make = NumpyBridge if self.array_api == "numpy" else TorchBridge
        return make(self, info, rows, show)

    def _task(self, initial: Array, keys: PlanKeys, space: PlanSpace, clips: bool = False) -> dict[str, Any]:
        return {
            "low": space.low,
            "high": space.high,
            "clips": clips,
            "categories": space.categories,
            "horizon": self.horizon,
            "action_block": self._config.action_block,
            "seeds": list(keys.seeds),
            "plans": list(keys.plans),
            "initial": np.ascontiguousarray(initial, np.float32).reshape(-1),
            "memory": [],
        }

    def _solve_chunk(
        self, info: dict[str, Any], initial: Array, keys: PlanKeys, space: PlanSpace
    ) -> tuple[dict[str, Any], Bridge]:
        rows = initial.shape[0]
        bridge = self._bridge(info, rows, initial)
        task = self._task(initial, keys, space, self._clips)
        task["memory"] = [
            self._memory[slot] if plan > 0 and slot in self._memory else []
            for slot, plan in zip(keys.slots, keys.plans, strict=True)
        ]
        for callback in self.callbacks or ():
            callback.start_batch()
        with self._mode():
            result = self._solver().solve(
                task,
                bridge,
                has_gradient=self.uses_gradient,
                constraints=self._constraints(bridge, initial),
                evaluations=self._evaluations(),
                traced=bool(self.callbacks),
            )
        shape = (rows, self.horizon, -1)
        for name in ("actions", "mean", "std"):
            result[name] = result[name].reshape(shape) if result[name].size else np.empty((rows, 0, 0), np.float32)
        for slot, values in zip(keys.slots, result["memory"], strict=True):
            self._memory[slot] = values
        return result, bridge

    def _constraints(self, bridge: Bridge, initial: Array) -> int:
        """C, for solvers that know constraints."""
        return 0

    def _mode(self) -> contextlib.AbstractContextManager[Any]:
        """torch's mode while the cost is called."""
        if self.array_api == "numpy":
            return contextlib.nullcontext()
        torch = torch_of(self.cost)
        return torch.enable_grad() if self.uses_gradient else torch.inference_mode()

    # Plans in and out.

    def _require_configured(self) -> PlanSpace:
        if self._space is None:
            raise PlanAssertionError(
                f"{type(self).__name__} does not know the actions yet; call configure(action_space=, n_envs=, config=) "
                "first, or give the solver to a WorldModelPolicy"
            )
        return self._space

    def _keys(self, info: dict[str, Any], total: int) -> PlanKeys:
        seeds = info.get("seed")
        if is_tensor(seeds):
            seeds = seeds.cpu().numpy()
        chosen = [int(seed) for seed in seeds.reshape(total, -1)[:, -1]] if is_array(seeds) else range(total)
        return PlanKeys(range(total), chosen, [self._calls] * total)

    def _initial(self, info: dict[str, Any], init_action: Any, total: int) -> Array:
        """Where the search begins: ``(B, H, plan values of a block)`` f32."""
        size = self._require_configured().values * self._config.action_block
        if self._asks_actor and self.array_api == "torch" and isinstance(self.cost, Actionable):
            init_action = prepare_init_action(
                self.cost, info, init_action, self.horizon, n_envs=total, action_dim=size, device=self.device
            )
        initial = np.zeros((total, self.horizon, size), np.float32)
        if init_action is not None:
            given = self._given(init_action)
            length = min(given.shape[1], self.horizon)
            initial[:, :length] = given[:, :length]
        return initial

    def _checked_start(self, init_action: Any, total: int) -> Any:
        """Where the search begins, as an array or tensor ``(total, t, D)``."""
        given = init_action if is_tensor(init_action) else np.asarray(init_action)
        space, block = self._require_configured(), self._config.action_block
        wanted = (space.actions if self._holds_integers(given) else space.values) * block
        if given.ndim != 3 or given.shape[0] != total or given.shape[2] != wanted:
            raise PlanAssertionError(
                f"init_action has the shape {tuple(given.shape)}, and {type(self).__name__} plans for {total} "
                f"rows of blocks of {self.action_dim} values; give ({total}, t, {self.action_dim})"
            )
        return given

    def _holds_integers(self, plan: Any) -> bool:
        """Whether a plan has one integer per action, and not the probabilities of its categories."""
        if not self._require_configured().categories:
            return False
        return not plan.is_floating_point() if is_tensor(plan) else np.issubdtype(np.asarray(plan).dtype, np.integer)

    def _given(self, init_action: Any) -> Array:
        """A plan that was given, as an array of plan values."""
        if self._holds_integers(init_action):
            values = init_action.cpu().numpy() if is_tensor(init_action) else np.asarray(init_action)
            return self._require_configured().one_hot(values.astype(np.int64))
        if not is_tensor(init_action):
            return np.asarray(init_action, np.float32)
        if init_action.device.type == "meta":  # It has a shape and no values.
            return np.zeros(tuple(init_action.shape), np.float32)
        return init_action.detach().float().cpu().numpy()

    def _actions(self, plans: Array, space: PlanSpace) -> Any:
        """Plans as actions."""
        return self.as_given(space.actions_of(plans) if space.categories else plans)

    def as_given(self, values: Array) -> Any:
        """An array as the caller knows them."""
        return values if self.array_api == "numpy" else torch_of(self.cost).from_numpy(values)

    def _continued(self, n_envs: int, actions: torch.Tensor | None) -> torch.Tensor:
        """``actions``, ``(n_envs, t, D)``, and zeros after them: a plan, ``(n_envs, H, D)``."""
        torch = torch_of(self.cost)
        begin = torch.zeros((n_envs, 0, self.action_dim), dtype=self.dtype) if actions is None else actions
        missing = max(self.horizon - begin.shape[1], 0)
        tail = torch.zeros((n_envs, missing, self.action_dim), dtype=self.dtype, device=begin.device)
        return torch.cat([begin, tail], dim=1)

    def _starts(self, n_envs: int, actions: Any, **changes: Any) -> torch.Tensor:
        """The sequences that a gradient solver descends from, ``(n_envs, S, H, D)``, on its device."""
        space = self._require_configured()
        keys = PlanKeys(range(n_envs), range(n_envs), [self._calls] * n_envs)
        initial = np.zeros((n_envs, self.horizon, space.values * self._config.action_block), np.float32)
        if actions is not None:
            given = self._given(actions)
            initial[:, : given.shape[1]] = given[:, : self.horizon]
        seen = FirstCandidates()
        self._solver(**changes).solve(
            self._task(initial, keys, space), seen, has_gradient=True, constraints=0, evaluations=1 << 62, traced=False
        )
        return torch_of(self.cost).from_numpy(seen.candidates).to(self.device)


def joined(results: list[dict[str, Any]], name: str) -> Array:
    """An array of the results of all chunks."""
    return np.concatenate([result[name] for result in results])


def _rows(keys: PlanKeys, rows: slice) -> PlanKeys:
    return PlanKeys(list(keys.slots)[rows], list(keys.seeds)[rows], list(keys.plans)[rows])


def torch_of(cost: Any) -> Any:
    return require_torch(f'{type(cost).__name__} has no `array_api = "numpy"`, so it is given torch tensors')
