"""Policies in Python: the base class, random actions, networks that act at once, and planning with a world model.

Policies of the core (``"expert"``, ``"cem:samples=300"``) are attached by name: ``world.set_policy("expert")``.
"""

from __future__ import annotations

import inspect
from collections import deque
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ._arrays import Array, is_array, is_tensor, require_torch
from ._prepare import (
    observed_columns,
    plan_bounds,
    refuse_misspelled,
    require_columns,
    require_method,
    require_settings,
    scale,
    setting_of,
    transform,
    unscale,
    with_note,
)
from .buffer import HistoryBuffer
from .planning.mpc import SimulatorCost
from .planning.solver._base import BaseSolver, PlanKeys
from .planning.solver._bridge import take_rows
from .planning.solver._errors import PlanAssertionError
from .planning.solver.solver import Solver
from .protocols import Actionable
from .world.policies import as_actions

if TYPE_CHECKING:
    from .protocols import Transformable

__all__ = [
    "ACTION_HISTORY_KEY",
    "BasePolicy",
    "ExpertPolicy",
    "FeedForwardPolicy",
    "HistoryBuffer",
    "PlanConfig",
    "Policy",
    "RandomPolicy",
    "WorldModelPolicy",
]

Infos = dict[str, Any]

ACTION_HISTORY_KEY = "action_history"
"""Where a cost finds the blocks executed between the frames of its history, ``(B, T - 1, action_block × A)``."""


@dataclass(frozen=True)
class PlanConfig:
    """How long plans are, and how much of each is executed.

    Attributes:
        horizon: H, blocks of a plan.
        receding_horizon: Blocks that are executed before the next plan; at most ``horizon``.
        history_len: Frames that the model is given, the present one included, ``action_block`` steps apart. An
            episode that is younger has fewer, and is planned for with those: none is made up.
        history_max_len: Steps that the history keeps; None: as many as ``history_len`` frames need.
        action_block: Actions of a block.
        warm_start: Begin a plan with what is left of the last one.
        clip_actions: Clip candidates to the bounds of the actions before the cost is given them, and actions before
            they are executed, as planners in Rust do. False: score and execute what was sampled, as the reference does.
    """

    horizon: int
    receding_horizon: int
    history_len: int = 1
    history_max_len: int | None = None
    action_block: int = 1
    warm_start: bool = True
    clip_actions: bool = True

    def __post_init__(self) -> None:
        for name in ("horizon", "receding_horizon", "history_len", "action_block"):
            if not isinstance(getattr(self, name), (int, np.integer)):
                raise TypeError(f"{name} must be a whole number, got {getattr(self, name)!r}")
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be >= 1, got {getattr(self, name)}")
        if self.receding_horizon > self.horizon:
            raise ValueError(
                f"receding_horizon is {self.receding_horizon}, and a plan has {self.horizon} blocks; lower it or raise "
                "horizon"
            )
        if self.history_max_len is not None and self.history_max_len < self.history_steps:
            raise ValueError(
                f"history_max_len={self.history_max_len} steps are fewer than {self.history_len} frames need, which are "
                f"{self.action_block} steps apart; leave it out, or give {self.history_steps} or more"
            )

    @property
    def history_steps(self) -> int:
        """Steps from the oldest frame to the present, both included."""
        return (self.history_len - 1) * self.action_block + 1

    @property
    def plan_len(self) -> int:
        """Environment steps of a plan."""
        return self.horizon * self.action_block


class BasePolicy:
    """The base of policies. A subclass writes ``get_action``; keyword arguments become attributes.

    Example:
        >>> class Still(BasePolicy):
        ...     def get_action(self, obs, **kwargs):
        ...         return np.zeros(self.env.action_space.shape, np.float32)
        >>> world.set_policy(Still())  # doctest: +SKIP
    """

    env: Any
    type: str
    _is_checked = False

    def __init__(self, **kwargs: Any) -> None:
        self.env = None
        self.type = "base"
        refuse_misspelled(type(self), kwargs)
        for name, value in kwargs.items():
            setattr(self, name, value)

    def get_action(self, obs: Any, /, **kwargs: Any) -> Any:
        """The next actions, ``(N, *A)``, from the infos, ``(N, 1, ...)`` each."""
        raise NotImplementedError

    def set_env(self, env: Any) -> None:
        """Tells the policy its environments: ``num_envs``, ``action_space``, ``single_action_space``."""
        self.env = env

    def describe(self) -> str:
        """What the policy is called in records and reports."""
        return type(self).__name__

    def _check_columns(self, info_dict: Infos) -> None:
        """Refuses scalings and transforms of columns that there are not, at the first action."""
        if not self._is_checked:
            settings = {name: getattr(self, name, {}) for name in ("process", "transform")}
            settings["history_keys"] = dict.fromkeys(getattr(self, "history_keys", None) or ())
            require_columns(settings, info_dict)
            self._is_checked = True

    def _prepare_info(self, info_dict: Infos, tensors: bool = True) -> Infos:
        """Infos as a model wants them: scaled by ``process``, images by ``transform``; torch tensors or NumPy arrays.

        What applies to a column applies to the goal's, too: that of ``proprio`` to ``goal_proprio``, that of ``pixels`` to
        ``goal``, unless they have one of their own.

        Args:
            info_dict: ``(N, T, ...)`` each; not changed.
            tensors: Whether arrays become torch tensors; for a NumPy cost, all are arrays.
        """
        process: dict[str, Any] = getattr(self, "process", {})
        transforms: dict[str, Any] = getattr(self, "transform", {})
        prepared: Infos = {}
        for key, value in info_dict.items():
            if (source := setting_of(process, key)) is not None:
                value = scale(process[source], key, value)
            if (source := setting_of(transforms, key)) is not None:
                value = transform(transforms[source], source, value)
                value = value if tensors else value.numpy()
            value = np.asarray(value) if np.isscalar(value) and hasattr(value, "dtype") else value
            if tensors and is_array(value) and value.dtype.kind not in "USO":
                what = 'models and costs without the attribute `array_api = "numpy"` take torch tensors'
                value = require_torch(what).from_numpy(value)
            prepared[key] = value
        return prepared


Policy = BasePolicy
"""The former name of :class:`BasePolicy`."""


class RandomPolicy(BasePolicy):
    """Samples actions from the action space.

    Args:
        seed: Seed of its noise, in addition to the episodes'; None: unseeded.

    With a seed, an episode's actions depend on the episode's own seed and not on the environments beside it; where
    episodes have none, the space of all environments is sampled. ``world.set_policy("random")`` is the policy of the
    core: faster, with other actions.
    """

    def __init__(self, seed: int | None = None, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.type = "random"
        self.seed = seed
        self._spaces: list[Any] = []

    def get_action(self, obs: Any, **kwargs: Any) -> Any:
        single, count = getattr(self.env, "single_action_space", None), getattr(self.env, "num_envs", 1)
        infos = cast("dict[str, Any]", obs) if isinstance(obs, dict) else {}
        seeds = _episode_seeds(self.env, infos, count) if infos else None
        if self.seed is None or seeds is None or single is None or single.shape is None:
            return self.env.action_space.sample()
        begun = _flags(infos.pop("_needs_flush", None), count) | _is_first(infos, count)
        if len(self._spaces) != count:
            self._spaces = [deepcopy(single) for _ in range(count)]
            begun[:] = True
        for index in np.flatnonzero(begun):
            state = np.random.SeedSequence([self.seed, int(seeds[index])]).generate_state(1)
            self._spaces[index].seed(int(state[0]))
        return np.stack([space.sample() for space in self._spaces]).reshape(self.env.action_space.shape)

    def set_env(self, env: Any) -> None:
        super().set_env(env)
        self._spaces = []
        if self.seed is not None:
            self._set_seed(self.seed)

    def _set_seed(self, seed: int) -> None:
        self.seed = seed
        if self.env is not None:
            self.env.action_space.seed(seed)


class ExpertPolicy(BasePolicy):
    """The base of scripted policies; it has no actions of its own.

    The experts of the environments are in the core: ``world.set_policy("expert")``.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.type = "expert"

    def get_action(self, obs: Any, goal_obs: Any = None, **kwargs: Any) -> Any:
        return None


class FeedForwardPolicy(BasePolicy):
    """A network that acts by one forward pass, such as a behavior-cloned one.

    Args:
        model: A torch module with ``get_action(info)``, ``(N, A)``. It is put into evaluation mode.
        process: Scalings of columns, ``{"proprio": StandardScaler(), …}``, and of ``goal_<column>``; that of ``action`` is
            inverted.
        transform: Transforms of images, ``{"pixels": …}``, one image ``(C, H, W)`` at a time; that of ``pixels`` applies to
            the goal unless there is a ``"goal"``.
        batch_size: Environments that the model is given at once; None: all. A network rounds by the size of its batch, so
            that results of different numbers of environments may differ by that; with 1 they are the same bits.
    """

    def __init__(
        self,
        model: Actionable,
        process: dict[str, Transformable] | None = None,
        transform: dict[str, Callable[[Any], Any]] | None = None,
        batch_size: int | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.type = "feed_forward"
        needed = "get_action(info): actions (N, A)"
        hint = "a world model plans: WorldModelPolicy(CEMSolver(ShootingCostEvaluator(model, objective)), config)"
        require_method("FeedForwardPolicy", model, "get_action", needed, hint)
        if batch_size is not None and batch_size < 1:
            raise ValueError(f"batch_size must be >= 1 or None, got {batch_size}")
        self.batch_size = batch_size
        self.model: Any = model.eval()  # type: ignore[attr-defined]
        require_settings(process, transform)
        self.process: dict[str, Transformable] = process or {}
        self.transform: dict[str, Callable[[Any], Any]] = transform or {}

    def get_action(self, info_dict: Infos, **kwargs: Any) -> Any:
        if "goal" not in info_dict:
            raise AssertionError("'goal' must be provided in info_dict; make the World with goal_conditioned=True")
        torch = require_torch("FeedForwardPolicy runs a torch model")
        self._check_columns(info_dict)
        count = len(info_dict["goal"])
        size = self.batch_size or count
        first = next(iter(self.model.parameters()), None)
        device = "cpu" if first is None else first.device
        parts: list[Any] = []
        for start in range(0, count, size):
            infos = self._prepare_info(take_rows(info_dict, slice(start, min(start + size, count))))
            infos["goal_pixels"] = infos["goal"]
            with torch.no_grad(), with_note(infos, self.transform):
                action = self.model.get_action(
                    {key: value.to(device) if is_tensor(value) else value for key, value in infos.items()}
                )
            told = f"the policy `{type(self.model).__name__}.get_action` returned"
            shape = getattr(getattr(self.env, "single_action_space", None), "shape", None)
            known = cast("tuple[int, ...]", shape) if isinstance(shape, tuple) else ()
            single = known or np.shape(action)[1:]
            parts.append(as_actions(told, action, (len(next(iter(infos.values()))), *single)))
        actions = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return unscale(self.process["action"], actions) if "action" in self.process else actions


class WorldModelPolicy(BasePolicy):
    """Plans with a solver and a model, executes ``receding_horizon`` blocks, and plans again.

    Every environment has a queue of actions, and is planned for when that is empty: those that are due at the same step
    and have equally many frames of history together. Infos are prepared for these only, so the steps between two plans
    cost next to nothing. Noise is that of the episode and the plan: the actions of an episode do not depend on the
    environments beside it, but for what a model rounds by the size of its batch, where the solver's ``batch_size`` is
    above 1.

    Args:
        solver: A solver of :mod:`stable_worldmodel_rs.planning`, or anything with its methods.
        config: Lengths of plans and of the history, and whether actions are clipped to their bounds.
        process: Scalings of columns, ``{"action": StandardScaler(), "proprio": …}``, and of ``goal_<column>``. Plans are in
            units of that of ``action``, which is inverted.
        transform: Transforms of images, ``{"pixels": …}``, one image ``(C, H, W)`` at a time; that of ``pixels`` applies to
            the goal unless there is a ``"goal"``. Without one, images are ``(H, W, C)`` uint8.
        history_keys: What the model is given several frames of, ``(B, T, …)``, with ``config.history_len`` above 1; other
            columns have T = 1, the present. None: all that is observed, so that no column has another T than ``pixels``.
            ``("pixels",)`` is the reference's. The blocks between the frames are under ``"action_history"``.

    A solver that is not of this package clips its candidates by itself, if at all; executed actions are clipped all the
    same.

    Example:
        >>> cost = ShootingCostEvaluator(model, GoalMSE())  # doctest: +SKIP
        >>> config = PlanConfig(horizon=5, receding_horizon=5, action_block=5)
        >>> policy = WorldModelPolicy(CEMSolver(cost, device="cuda"), config)  # doctest: +SKIP
        >>> world.set_policy(policy)  # doctest: +SKIP
    """

    def __init__(
        self,
        solver: Solver,
        config: PlanConfig,
        process: dict[str, Transformable] | None = None,
        transform: dict[str, Callable[[Any], Any]] | None = None,
        history_keys: Sequence[str] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        if isinstance(history_keys, str):
            raise TypeError(f"history_keys={history_keys!r} is a text; give a list: [{history_keys!r}]")
        if isinstance(getattr(solver, "cost", None), SimulatorCost):
            raise PlanAssertionError(
                "WorldModelPolicy plans with a cost in Python, and SimulatorCost is in Rust; use MpcPolicy(solver, config=config)"
            )
        if not all(hasattr(config, name) for name in ("horizon", "receding_horizon", "action_block")):
            raise TypeError(f"config is {config!r}; give a PlanConfig(horizon=, receding_horizon=, action_block=)")
        self.type = "world_model"
        self.cfg = config
        self.solver: Any = solver
        require_settings(process, transform)
        self.process: dict[str, Transformable] = process or {}
        self.transform: dict[str, Callable[[Any], Any]] = transform or {}
        self.history_keys: tuple[str, ...] | None = None if history_keys is None else tuple(history_keys)
        self._observed: tuple[str, ...] = ()
        self._clipped_to: tuple[Array, Array] | None = None
        self._action_buffer: list[deque[Array]] | None = None
        self._next_init: Any = None
        self._has_rest: Array = np.zeros(0, bool)
        self._history_buffer: HistoryBuffer | None = None
        self._plans: list[int] = []
        self._gives_keys = False
        self._zeros_differ = True

    @property
    def flatten_receding_horizon(self) -> int:
        """Environment steps from one plan to the next."""
        return self.cfg.receding_horizon * self.cfg.action_block

    def describe(self) -> str:
        cost = type(getattr(self.solver, "cost", None)).__name__
        config = self.cfg
        more = "".join(
            f", {name}={getattr(config, name)}"
            for name, default in (("history_len", 1), ("warm_start", True))
            if getattr(config, name) != default
        )
        return (
            f"WorldModelPolicy({type(self.solver).__name__}, {cost}, horizon={config.horizon}, "
            f"receding_horizon={config.receding_horizon}, action_block={config.action_block}{more}, "
            f"clip_actions={self._clips})"
        )

    @property
    def _clips(self) -> bool:
        """Whether actions are clipped. A configuration of another package may not have the setting."""
        return bool(getattr(self.cfg, "clip_actions", True))

    def set_env(self, env: Any) -> None:
        self.env = env
        count = getattr(env, "num_envs", 1)
        if isinstance(self.solver, type) or not callable(getattr(self.solver, "configure", None)):
            raise TypeError(f"{self.solver!r} is no solver; give an object such as CEMSolver(cost), or world.set_policy a name")
        self.solver.configure(action_space=env.action_space, n_envs=count, config=self.cfg)
        if not isinstance(self.solver, Solver):
            raise TypeError(
                f"{type(self.solver).__name__} is no solver; it needs configure, solve, action_dim, n_envs and horizon, "
                "as stable_worldmodel_rs.planning.Solver has"
            )
        # A solver of ours whose `solve` was overridden as the reference knows it has no keys.
        arguments = inspect.signature(self.solver.solve).parameters.values()
        takes_keys = any(one.name == "keys" or one.kind is one.VAR_KEYWORD for one in arguments)
        is_ours = isinstance(self.solver, BaseSolver)
        self._gives_keys = takes_keys and is_ours
        # Zeros are what a search begins with, but where a model's own actions do, where zeros are a plan of integers, and
        # where a solver of others decides.
        solver: Any = self.solver
        self._zeros_differ: bool = not is_ours or isinstance(solver.cost, Actionable) or solver.plans_integers
        self._clipped_to = None
        if self._clips and (bounds := plan_bounds(env.single_action_space, self.process.get("action"))) is not None:
            self._clipped_to, planned = bounds
            if is_ours:
                solver.set_bounds(*planned)
        self._observed = observed_columns(env)
        self._action_buffer = [deque(maxlen=self.flatten_receding_horizon) for _ in range(count)]
        self._next_init = None
        self._has_rest = np.zeros(count, bool)
        self._plans = [0] * count
        self._history_buffer = None
        if self.cfg.history_len > 1:
            self._history_buffer = HistoryBuffer(
                n_envs=count,
                max_len=self.cfg.history_max_len or self.cfg.history_steps,
                action_block=self.cfg.action_block,
                block_keys=("action",),
            )

    @property
    def _takes_tensors(self) -> bool:
        return getattr(self.solver, "array_api", "torch") != "numpy"

    def get_action(self, info_dict: Infos, **kwargs: Any) -> Any:
        """The next actions, ``(N, *A)``: NaN (0 for integers) in environments whose episode is over.

        They are what is executed and recorded: in the environment's units, clipped with ``config.clip_actions``.
        """
        queues = self._action_buffer
        if queues is None:
            raise TypeError("WorldModelPolicy has no environment yet; call world.set_policy(policy), or set_env(envs)")
        count = self.env.num_envs
        self._check_columns(info_dict)
        begun = _flags(info_dict.pop("_needs_flush", None), count) | _is_first(info_dict, count)
        self._forget(np.flatnonzero(begun))
        is_over = _flags(info_dict.get("terminated"), count) | _flags(info_dict.get("truncated"), count)
        is_over &= ~begun
        if self._history_buffer is not None:
            # Images are prepared where they are planned with, which is not every step.
            recent = {key: info_dict[key] for key in self._history_columns(info_dict)}
            self._history_buffer.append(recent | self._prepare_info({"action": info_dict["action"]}, tensors=False))
        due = [index for index in range(count) if not queues[index] and not is_over[index]]
        for frames, alike in self._alike(due):
            self._plan(info_dict, alike, frames, queues)
        single = self.env.single_action_space
        if "Discrete" in type(single).__name__:
            actions = np.zeros((count, *single.shape), np.int64)
        else:
            actions = np.full((count, *single.shape), np.nan, np.float32)
        for index in np.flatnonzero(~is_over):
            actions[index] = queues[index].popleft().reshape(single.shape)
        actions: Array = actions.reshape(self.env.action_space.shape)
        if "action" in self.process:
            actions = unscale(self.process["action"], actions)
        return actions if self._clipped_to is None else np.clip(actions, *self._clipped_to)

    def _history_columns(self, info_dict: Infos) -> tuple[str, ...]:
        """The columns of which several frames are kept."""
        if self.history_keys is None:
            seen = [key for key in self._observed if is_array(info_dict.get(key)) or is_tensor(info_dict.get(key))]
            return tuple(seen) if seen else ("pixels",) if "pixels" in info_dict else ()
        return self.history_keys

    def _alike(self, due: list[int]) -> list[tuple[int, list[int]]]:
        """The environments ``due`` by what their plans begin with, so that none depends on which others are due: the frames
        of their history, and whether there is a rest of the last plan."""
        buffer = self._history_buffer
        real = [1] * len(due) if buffer is None else buffer.num_strided(due)
        groups: dict[tuple[int, bool], list[int]] = {}
        for index, frames in zip(due, real, strict=True):
            begins = self._zeros_differ and bool(self._has_rest[index])
            groups.setdefault((min(self.cfg.history_len, frames), begins), []).append(index)
        return [(frames, alike) for (frames, _), alike in sorted(groups.items())]

    def _forget(self, begun: Array) -> None:
        """New episodes have begun in these environments."""
        for index in begun:
            self._action_buffer[index].clear()  # type: ignore[index]
            self._plans[index] = 0
            self._has_rest[index] = False
            if self._next_init is not None:
                self._next_init[index] = 0
        if self._history_buffer is not None and begun.size:
            self._history_buffer.reset([int(index) for index in begun])

    def _plan(self, info_dict: Infos, due: list[int], frames: int, queues: list[deque[Array]]) -> None:
        """Plans for the environments ``due``, which all have ``frames`` frames of history, and fills their queues."""
        rows = take_rows(info_dict, due)
        blocks = None
        if self._history_buffer is not None:
            history = self._history_buffer.get(frames, env_ids=due) or {}
            blocks = history.pop("action", None)
            rows |= history
        infos = self._prepare_info(rows, self._takes_tensors)
        if blocks is not None:
            infos[ACTION_HISTORY_KEY] = require_torch("tensors").from_numpy(blocks) if self._takes_tensors else blocks
        begins = self._next_init is not None and not (self._zeros_differ and not self._has_rest[due[0]])
        initial: Any = cast("Any", self._next_init)[due] if begins else None
        known = {"keys": self._keys(info_dict, due)} if self._gives_keys else {}
        with with_note(infos, self.transform):
            result = self.solver(infos, init_action=initial, **known)
        now = result["actions"][:, : self.cfg.receding_horizon]
        # The search goes on from what it found, not from what of it can be executed.
        rest = result.get("unclipped", result["actions"])[:, self.cfg.receding_horizon :]
        if not self.cfg.warm_start:
            self._next_init = None
        elif rest.shape[1] > 0:
            if self._next_init is None:
                shape = (len(queues), *rest.shape[1:])
                self._next_init = rest.new_zeros(shape) if is_tensor(rest) else np.zeros(shape, rest.dtype)
            self._next_init[due] = rest
            self._has_rest[due] = True
        now = now.detach().cpu().numpy() if is_tensor(now) else np.asarray(now)
        for index, actions in zip(due, now.reshape(len(due), self.flatten_receding_horizon, -1), strict=True):
            queues[index].extend(actions)
            self._plans[index] += 1

    def _keys(self, info_dict: Infos, due: list[int]) -> PlanKeys:
        """Which plan of which episode each row is. Episodes without a seed have the number of their environment."""
        seeds = _episode_seeds(self.env, info_dict, len(self._plans))
        chosen = [index if seeds is None else int(seeds[index]) for index in due]
        return PlanKeys(due, chosen, [self._plans[index] for index in due])


def _episode_seeds(env: Any, info_dict: Infos, count: int) -> Array | None:
    """The seed of every environment's episode, ``(N,)``: the column ``seed``, or what environments in Python were reset
    with. None where that is unknown."""
    seeds: Any = info_dict.get("seed")
    if seeds is None and np.all(getattr(env, "seeded", False)):
        seeds = env.seeds
    return None if seeds is None else np.asarray(seeds).reshape(count, -1)[:, -1]


def _flags(values: Any, count: int) -> Array:
    """The newest flag of every environment; False where there are none."""
    if values is None:
        return np.zeros(count, bool)
    return np.asarray(values, dtype=bool).reshape(count, -1)[:, -1].copy()


def _is_first(info_dict: Infos, count: int) -> Array:
    """Where the step is the first of an episode: a reset by hand says no more than this."""
    steps = info_dict.get("step_idx")
    return np.zeros(count, bool) if steps is None else np.asarray(steps).reshape(count, -1)[:, -1] == 0
