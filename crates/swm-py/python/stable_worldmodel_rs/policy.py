"""Policies in Python: the base class, random actions, networks that act at once, and planning with a world model.

Policies of the core (``"expert"``, ``"cem:samples=300"``) are attached by name: ``world.set_policy("expert")``.
"""

from __future__ import annotations

import inspect
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ._arrays import Array, is_array, is_tensor, require_torch
from ._prepare import note_unused, scale, transform
from .buffer import HistoryBuffer
from .planning.solver._base import BaseSolver, PlanKeys
from .planning.solver._bridge import take_rows
from .planning.solver.solver import Solver

if TYPE_CHECKING:
    from .protocols import Actionable, Transformable

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
        history_len: Frames that the model is given, the present one included, ``action_block`` steps apart. Young
            episodes have fewer; where they are planned for together with older ones, copies of their first frame and
            blocks of zeros stand in front.
        history_max_len: Steps that the history keeps; None: as many as ``history_len`` frames need.
        action_block: Actions of a block.
        warm_start: Begin a plan with what is left of the last one.
    """

    horizon: int
    receding_horizon: int
    history_len: int = 1
    history_max_len: int | None = None
    action_block: int = 1
    warm_start: bool = True

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

    def _note_unused(self, info_dict: Infos) -> None:
        """Notes once which scalings and transforms no column has."""
        if not self._is_checked:
            self._is_checked = True
            settings = {name: getattr(self, name, {}) for name in ("process", "transform")}
            note_unused(settings, info_dict)

    def _prepare_info(self, info_dict: Infos, tensors: bool = True) -> Infos:
        """Infos as a model wants them: scaled by ``process``, images by ``transform``; torch tensors or NumPy arrays.

        Args:
            info_dict: ``(N, T, ...)`` each; not changed.
            tensors: Whether arrays become torch tensors; for a NumPy cost, all are arrays.
        """
        process: dict[str, Any] = getattr(self, "process", {})
        transforms: dict[str, Any] = getattr(self, "transform", {})
        prepared: Infos = {}
        for key, value in info_dict.items():
            if key in process:
                value = scale(process[key], key, value)
            if key in transforms:
                value = transform(transforms[key], key, value)
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
        seed: Seed of the action space, set when the policy is attached; None: unseeded.

    ``world.set_policy("random")`` is the policy of the core: faster, and keyed by the episodes' seeds.
    """

    def __init__(self, seed: int | None = None, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.type = "random"
        self.seed = seed

    def get_action(self, obs: Any, **kwargs: Any) -> Any:
        return self.env.action_space.sample()

    def set_env(self, env: Any) -> None:
        super().set_env(env)
        if self.seed is not None:
            self._set_seed(self.seed)

    def _set_seed(self, seed: int) -> None:
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
        process: Scalings of columns, ``{"proprio": StandardScaler(), …}``; that of ``action`` is inverted.
        transform: Transforms of images, ``{"pixels": …, "goal": …}``, one image ``(C, H, W)`` at a time.
    """

    def __init__(
        self,
        model: Actionable,
        process: dict[str, Transformable] | None = None,
        transform: dict[str, Callable[[Any], Any]] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.type = "feed_forward"
        self.model: Any = model.eval()  # type: ignore[attr-defined]
        self.process: dict[str, Transformable] = process or {}
        self.transform: dict[str, Callable[[Any], Any]] = transform or {}

    def get_action(self, info_dict: Infos, **kwargs: Any) -> Any:
        if "goal" not in info_dict:
            raise AssertionError("'goal' must be provided in info_dict; make the World with goal_conditioned=True")
        torch = require_torch("FeedForwardPolicy runs a torch model")
        self._note_unused(info_dict)
        infos = self._prepare_info(info_dict)
        infos["goal_pixels"] = infos["goal"]
        first = next(iter(self.model.parameters()), None)
        device = "cpu" if first is None else first.device
        with torch.no_grad():
            action = self.model.get_action(
                {key: value.to(device) if is_tensor(value) else value for key, value in infos.items()}
            )
        if is_tensor(action):
            action = action.detach().float().cpu().numpy()
        if "action" in self.process:
            action = self.process["action"].inverse_transform(action)
        return action


class WorldModelPolicy(BasePolicy):
    """Plans with a solver and a model, executes ``receding_horizon`` blocks, and plans again.

    Every environment has a queue of actions, and is planned for when that is empty: those that are due at the same step
    together. Infos are prepared for these only, so the steps between two plans cost next to nothing. Noise is that of
    the episode and the plan: the actions of an episode do not depend on the environments beside it.

    Args:
        solver: A solver of :mod:`stable_worldmodel_rs.planning`, or anything with its methods.
        config: Lengths of plans and of the history.
        process: Scalings of columns, ``{"action": StandardScaler(), "proprio": …}``. Plans are in units of that of
            ``action``, which is inverted.
        transform: Transforms of images, ``{"pixels": …, "goal": …}``, one image ``(C, H, W)`` at a time.
        history_keys: What the model is given several frames of, with ``config.history_len`` above 1; the blocks between
            them are under ``"action_history"``.

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
        history_keys: Sequence[str] = ("pixels",),
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.type = "world_model"
        self.cfg = config
        self.solver: Any = solver
        self.process: dict[str, Transformable] = process or {}
        self.transform: dict[str, Callable[[Any], Any]] = transform or {}
        self.history_keys: tuple[str, ...] = tuple(history_keys)
        self._action_buffer: list[deque[Array]] | None = None
        self._next_init: Any = None
        self._history_buffer: HistoryBuffer | None = None
        self._plans: list[int] = []
        self._gives_keys = False

    @property
    def flatten_receding_horizon(self) -> int:
        """Environment steps from one plan to the next."""
        return self.cfg.receding_horizon * self.cfg.action_block

    def describe(self) -> str:
        cost = type(getattr(self.solver, "cost", None)).__name__
        config = self.cfg
        return (
            f"WorldModelPolicy({type(self.solver).__name__}, {cost}, horizon={config.horizon}, "
            f"receding_horizon={config.receding_horizon}, action_block={config.action_block})"
        )

    def set_env(self, env: Any) -> None:
        self.env = env
        count = getattr(env, "num_envs", 1)
        self.solver.configure(action_space=env.action_space, n_envs=count, config=self.cfg)
        if not isinstance(self.solver, Solver):
            raise TypeError(
                f"{type(self.solver).__name__} is no solver; it needs configure, solve, action_dim, n_envs and horizon, "
                "as stable_worldmodel_rs.planning.Solver has"
            )
        # A solver of ours whose `solve` was overridden as the reference knows it has no keys.
        arguments = inspect.signature(self.solver.solve).parameters.values()
        takes_keys = any(one.name == "keys" or one.kind is one.VAR_KEYWORD for one in arguments)
        self._gives_keys = takes_keys and isinstance(self.solver, BaseSolver)
        self._action_buffer = [deque(maxlen=self.flatten_receding_horizon) for _ in range(count)]
        self._next_init = None
        self._plans = [0] * count
        self._history_buffer = None
        if self.cfg.history_len > 1:
            needed = (self.cfg.history_len - 1) * self.cfg.action_block + 1
            self._history_buffer = HistoryBuffer(
                n_envs=count,
                max_len=self.cfg.history_max_len or needed,
                action_block=self.cfg.action_block,
                block_keys=("action",),
            )

    @property
    def _takes_tensors(self) -> bool:
        return getattr(self.solver, "array_api", "torch") != "numpy"

    def get_action(self, info_dict: Infos, **kwargs: Any) -> Any:
        """The next actions, ``(N, *A)``: NaN (0 for integers) in environments whose episode is over."""
        queues = self._action_buffer
        if queues is None:
            raise TypeError("WorldModelPolicy has no environment yet; call world.set_policy(policy), or set_env(envs)")
        count = self.env.num_envs
        self._note_unused(info_dict)
        begun = _flags(info_dict.pop("_needs_flush", None), count) | _is_first(info_dict, count)
        self._forget(np.flatnonzero(begun))
        is_over = _flags(info_dict.get("terminated"), count) | _flags(info_dict.get("truncated"), count)
        is_over &= ~begun
        if self._history_buffer is not None:
            recent = {key: info_dict[key] for key in (*self.history_keys, "action")}
            self._history_buffer.append(self._prepare_info(recent, self._takes_tensors))
        due = [index for index in range(count) if not queues[index] and not is_over[index]]
        if due:
            self._plan(info_dict, due, queues)
        single = self.env.single_action_space
        if "Discrete" in type(single).__name__:
            actions = np.zeros((count, *single.shape), np.int64)
        else:
            actions = np.full((count, *single.shape), np.nan, np.float32)
        for index in np.flatnonzero(~is_over):
            actions[index] = queues[index].popleft().reshape(single.shape)
        actions: Array = actions.reshape(self.env.action_space.shape)
        return self.process["action"].inverse_transform(actions) if "action" in self.process else actions

    def _forget(self, begun: Array) -> None:
        """New episodes have begun in these environments."""
        for index in begun:
            self._action_buffer[index].clear()  # type: ignore[index]
            self._plans[index] = 0
            if self._next_init is not None:
                self._next_init[index] = 0
        if self._history_buffer is not None and begun.size:
            self._history_buffer.reset([int(index) for index in begun])

    def _plan(self, info_dict: Infos, due: list[int], queues: list[deque[Array]]) -> None:
        """Plans for the environments ``due``, and fills their queues."""
        infos = self._prepare_info(take_rows(info_dict, due), self._takes_tensors)
        if self._history_buffer is not None:
            real = max(self._history_buffer.num_strided(due))
            history = self._history_buffer.get(min(self.cfg.history_len, real), env_ids=due) or {}
            blocks = history.pop("action", None)
            infos |= history
            if blocks is not None:
                infos[ACTION_HISTORY_KEY] = blocks
        initial = None if self._next_init is None else self._next_init[due]
        known = {"keys": self._keys(info_dict, due)} if self._gives_keys else {}
        plans = self.solver(infos, init_action=initial, **known)["actions"]
        now, rest = plans[:, : self.cfg.receding_horizon], plans[:, self.cfg.receding_horizon :]
        if not self.cfg.warm_start:
            self._next_init = None
        elif rest.shape[1] > 0:
            if self._next_init is None:
                shape = (len(queues), *rest.shape[1:])
                self._next_init = rest.new_zeros(shape) if is_tensor(rest) else np.zeros(shape, rest.dtype)
            self._next_init[due] = rest
        now = now.detach().cpu().numpy() if is_tensor(now) else np.asarray(now)
        for index, actions in zip(due, now.reshape(len(due), self.flatten_receding_horizon, -1), strict=True):
            queues[index].extend(actions)
            self._plans[index] += 1

    def _keys(self, info_dict: Infos, due: list[int]) -> PlanKeys:
        """Which plan of which episode each row is. Environments without a column ``seed`` are their own seeds."""
        seeds: Any = info_dict.get("seed")
        flat = np.asarray(seeds).reshape(len(self._plans), -1)[:, -1] if seeds is not None else None
        chosen = [index if flat is None else int(flat[index]) for index in due]
        return PlanKeys(due, chosen, [self._plans[index] for index in due])


def _flags(values: Any, count: int) -> Array:
    """The newest flag of every environment; False where there are none."""
    if values is None:
        return np.zeros(count, bool)
    return np.asarray(values, dtype=bool).reshape(count, -1)[:, -1].copy()


def _is_first(info_dict: Infos, count: int) -> Array:
    """Where the step is the first of an episode: a reset by hand says no more than this."""
    steps = info_dict.get("step_idx")
    return np.zeros(count, bool) if steps is None else np.asarray(steps).reshape(count, -1)[:, -1] == 0
