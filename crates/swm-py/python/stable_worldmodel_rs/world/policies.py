"""Policies of the core by their names, as on the command line: `expert`, `cem:samples=300`."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, ItemsView, Iterable, Iterator, Mapping, ValuesView
from copy import copy
from functools import partial
from pathlib import Path
from typing import Any, TypeGuard, cast

from .._core import core as _swm
from .native import whole


# What results call a reference policy, and the policy that it is.
_ALIASES = {"no-op": "constant", "no_op": "constant"}


class NativePolicy:
    """A policy of the core, which runs whole episodes without Python.

    Args:
        text: Name and arguments: ``"random"``, ``"noisy-expert:std=0.2"``, ``"cem:samples=300,horizon=5"``;
            ``"cem:@file.json"`` takes the arguments from a file (JSON or TOML), and ``"no-op"`` is ``"constant"`` without values. ``swm-rs envs ENV`` lists the policies of
            an environment.
        seed: Seed of its own noise; 0: noise comes from the episodes' seeds.
        **settings: Further arguments.

    Example:
        >>> NativePolicy("cem", samples=300).text
        'cem:samples=300'
    """

    def __init__(self, text: str, *, seed: int = 0, **settings: Any) -> None:
        name, _, rest = text.partition(":")
        name = _ALIASES.get(name.strip(), name)
        parts = [part for part in rest.split(",") if part]
        if parts and parts[0].startswith("@"):
            given = {**_read(Path(parts.pop(0)[1:])), **settings}
        else:
            given = settings
        parts += [f"{key}={_literal(value)}" for key, value in given.items()]
        self.text: str = name + (":" + ",".join(parts) if parts else "")
        self.seed: int = whole("seed", seed)

    def __repr__(self) -> str:
        return f"NativePolicy({self.text!r})"


class FunctionPolicy:
    """A function of the infos as a policy.

    Args:
        function: Takes the infos, arrays ``(N, 1, …)``, and returns actions ``(N, *A)``.
    """

    def __init__(self, function: Callable[[dict[str, Any]], Any]) -> None:
        self.get_action = function

    def describe(self) -> str:
        """The function's name."""
        return str(getattr(self.get_action, "__name__", "function"))


def _is_function(policy: object) -> TypeGuard[Callable[[dict[str, Any]], Any]]:
    """Whether it is a function or a method; what it takes shows in its first call."""
    return inspect.isroutine(policy) or isinstance(policy, partial)


def as_policy(policy: Any) -> Any:
    """An object with ``get_action``: the policy, or a function as one.

    Raises:
        TypeError: It is neither.
    """
    if isinstance(policy, type):
        raise TypeError(f"a policy is an object, and {policy.__name__} is its class; make one: {policy.__name__}()")
    if callable(getattr(policy, "get_action", None)):
        return policy
    if _is_function(policy):
        return FunctionPolicy(policy)
    raise TypeError(
        f"a policy is a name such as 'expert', a function of the infos, or an object with get_action(infos), found {policy!r}"
    )


def describe(policy: Any) -> str:
    """What a policy is called in records: what its ``describe()`` says, else its class."""
    own = getattr(policy, "describe", None)
    return str(own()) if callable(own) else type(policy).__name__


def ask(policy: Any, infos: dict[str, Any], space: Any) -> Any:
    """The actions that a policy returns for the infos; ``space`` is that of all environments' actions.

    The policy gets infos of its own, to keep or to change: what is recorded stays as it is.

    Raises:
        PolicyError: It returned None, as a function without ``return`` does.
    """
    actions = policy.get_action(PolicyInfos(infos))
    if actions is None:
        raise _swm.PolicyError(
            f"the policy `{describe(policy)}` returned None; it must return actions of shape {space.shape}, one row per "
            "environment"
        )
    return actions


class PolicyInfos(dict[str, Any]):
    """The infos of a step as a policy gets them: every column is copied where it is read first, and then the policy's own."""

    # Names of columns that were not read yet: views of what is recorded.
    _shared: set[str] = set()

    def __init__(self, infos: Mapping[str, Any] | Iterable[tuple[str, Any]] = ()) -> None:
        super().__init__(infos)
        self._shared = set(super().keys())

    def __getitem__(self, name: str) -> Any:
        value = super().__getitem__(name)
        if name in self._shared:
            self[name] = value = _own(value)
        return value

    def __setitem__(self, name: str, value: Any) -> None:
        if name in self._shared:
            self._shared.remove(name)
        super().__setitem__(name, value)

    def __iter__(self) -> Iterator[str]:
        # With a method of its own, `dict(infos)` and `{**infos}` read by `__getitem__`.
        return super().__iter__()

    def get(self, name: str, default: Any = None) -> Any:
        """As of `dict`."""
        return self[name] if name in self else default

    def pop(self, name: str, *default: Any) -> Any:
        """As of `dict`."""
        if name in self:
            self[name]
        return super().pop(name, *default)

    def items(self) -> ItemsView[str, Any]:  # type: ignore[override]
        """As of `dict`."""
        return ItemsView(self)

    def values(self) -> ValuesView[Any]:  # type: ignore[override]
        """As of `dict`."""
        return ValuesView(self)

    def copy(self) -> dict[str, Any]:
        """As of `dict`."""
        return dict(self)


def _own(values: Any) -> Any:
    """A copy of a column of the infos: an array, a tensor, or lists of lists."""
    if isinstance(values, list):
        return [list(row) for row in cast("list[list[Any]]", values)]
    return values.clone() if hasattr(values, "clone") else copy(values)


def _literal(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _read(path: Path) -> dict[str, Any]:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".json":
        return dict(json.loads(text))
    try:
        import tomllib
    except ImportError:
        raise ValueError(f"{path}: TOML needs Python 3.11 or later; use a JSON file") from None
    return dict(tomllib.loads(text))
