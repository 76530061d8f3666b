"""Gymnasium's spaces with a value of their own: what a factor of variation may be, and what it is now.

An environment's factors are one nested `Dict`, the ``variation_space``. Its leaves keep an initial value, the value of
the present episode, and a constraint:

    >>> env = gymnasium.make("swm/PushT-v1")
    >>> env.reset(seed=0, options={"variation": ["agent.color"]})
    >>> env.unwrapped.variation_space["agent"]["color"].value
    array([ 17, 201,  94], dtype=uint8)

Spaces built from an environment show what the environment has sampled. To choose values, pass
``options={"variation_values": {"agent.color": [255, 0, 0]}}`` to ``reset``: writing to the space changes the space
alone.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeGuard, cast

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

__all__ = ["Box", "Dict", "Discrete", "MultiDiscrete", "RGBBox", "reset_variation_space"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs.spaces")

Constraint = Callable[[Any], bool]


def _always(_value: Any) -> bool:
    """The constraint of a space without one."""
    return True


def _until_valid(
    draw: Callable[[], Any], is_valid: Constraint, name: str, max_tries: int, warn_after_s: float | None
) -> Any:
    """Draw until a value is valid; warn once it takes longer than ``warn_after_s``."""
    start = time.monotonic()
    warned = warn_after_s is None
    for _ in range(max_tries):
        value = draw()
        if is_valid(value):
            return value
        if not warned and time.monotonic() - start >= (warn_after_s or 0.0):
            logger.warning(
                "%s: rejection sampling has found no value for %s s; is the constraint too strict?", name, warn_after_s
            )
            warned = True
    raise RuntimeError(f"{name}: constrain_fn not satisfied after {max_tries} samples; loosen it, or raise max_tries")


class _Valued(spaces.Space[Any]):
    """A leaf that holds an initial and a present value. Mixed into gymnasium's spaces, which come after it."""

    constrain_fn: Constraint
    _init_value: Any
    _value: Any

    def _hold(self, init_value: Any, constrain_fn: Constraint | None) -> None:
        self.constrain_fn = constrain_fn or _always
        self._init_value = init_value
        self._value = init_value

    @property
    def init_value(self) -> Any:
        """The value that `reset` returns to; None if there is none."""
        return self._init_value

    @property
    def value(self) -> Any:
        """The present value; None before there is one."""
        return self._value

    def reset(self) -> None:
        """Return to the initial value."""
        self._value = self._init_value

    def contains(self, x: Any) -> bool:
        """Whether ``x`` lies in the space and satisfies the constraint."""
        return bool(super().contains(x)) and bool(self.constrain_fn(x))

    def check(self) -> bool:
        """Whether the present value is valid."""
        if not self.constrain_fn(self._value):
            logger.warning("%s: the value %s does not satisfy constrain_fn", type(self).__name__, self._value)
            return False
        return bool(super().contains(self._value))

    def sample(
        self,
        mask: Any | None = None,
        probability: Any | None = None,
        *,
        max_tries: int = 1000,
        warn_after_s: float | None = 5.0,
        set_value: bool = True,
    ) -> Any:
        """Sample a valid value, and make it the present one unless ``set_value`` is False.

        Raises:
            RuntimeError: ``max_tries`` samples did not satisfy the constraint.
        """
        draw = super().sample
        name = type(self).__name__
        value = _until_valid(lambda: draw(mask, probability), self.contains, name, max_tries, warn_after_s)
        if set_value:
            self._value = value
        return value

    def _valid(self, value: Any) -> Any:
        if not self.contains(value):
            raise ValueError(f"the value {value} does not lie in {self}; choose one that does, of dtype {self.dtype}")
        return value

    def set_init_value(self, value: Any) -> None:
        """Change the initial value. Raises ValueError if it is not valid."""
        self._init_value = self._valid(value)

    def set_value(self, value: Any) -> None:
        """Change the present value. Raises ValueError if it is not valid."""
        self._value = self._valid(value)


class Discrete(_Valued, spaces.Discrete):
    """One integer in ``start .. start + n``."""

    def __init__(
        self, n: int, init_value: int | None = None, constrain_fn: Constraint | None = None, **kwargs: Any
    ) -> None:
        spaces.Discrete.__init__(self, n, **kwargs)
        self._hold(init_value, constrain_fn)


class MultiDiscrete(_Valued, spaces.MultiDiscrete):
    """Several integers, element ``i`` in ``start[i] .. start[i] + nvec[i]``."""

    def __init__(
        self, nvec: Any, init_value: Any | None = None, constrain_fn: Constraint | None = None, **kwargs: Any
    ) -> None:
        spaces.MultiDiscrete.__init__(self, nvec, **kwargs)
        self._hold(init_value, constrain_fn)


class Box(_Valued, spaces.Box):
    """Real numbers between bounds, both included."""

    def __init__(
        self,
        low: Any,
        high: Any,
        shape: Sequence[int] | None = None,
        dtype: Any = np.float32,
        init_value: Any | None = None,
        constrain_fn: Constraint | None = None,
        **kwargs: Any,
    ) -> None:
        spaces.Box.__init__(self, low, high, shape=shape, dtype=dtype, **kwargs)
        self._hold(init_value, constrain_fn)


class RGBBox(Box):
    """Colors: uint8 in 0 to 255, with an axis of 3 channels."""

    def __init__(self, shape: Sequence[int] = (3,), init_value: Any | None = None, **kwargs: Any) -> None:
        if 3 not in shape:
            raise ValueError(f"shape must have a channel of size 3, found {tuple(shape)}")
        super().__init__(0, 255, shape=shape, dtype=np.uint8, init_value=init_value, **kwargs)


def _inner(space: spaces.Dict) -> dict[str, Any]:
    """The spaces of a dictionary, by name; which methods they have, their classes say."""
    return cast("dict[str, Any]", space.spaces)


def _is_dict(space: object) -> TypeGuard[spaces.Dict]:
    """Whether there are spaces within the space."""
    return isinstance(space, spaces.Dict)


class Dict(spaces.Dict):
    """Named spaces, which may be dictionaries themselves. Dotted names reach into them: ``agent.color``."""

    def __init__(
        self,
        spaces_dict: Mapping[str, spaces.Space[Any]] | None = None,
        init_value: dict[str, Any] | None = None,
        constrain_fn: Constraint | None = None,
        sampling_order: Sequence[str] | None = None,
        **kwargs: Any,
    ) -> None:
        """Args:
        spaces_dict: The spaces, by name.
        init_value: Not used: initial values are those of the contained spaces.
        constrain_fn: A rule between the values, called with the dict of them.
        sampling_order: The order in which the entries are sampled. Names that it lacks are appended.
        """
        super().__init__(dict(spaces_dict or {}), **kwargs)  # pyright: ignore[reportUnknownMemberType]  gymnasium's `seed`
        self.constrain_fn: Constraint = constrain_fn or _always
        self._sampling_order = list(self.spaces if sampling_order is None else sampling_order)
        unknown = [name for name in self._sampling_order if name not in self.spaces]
        if unknown:
            raise ValueError(f"sampling_order names {unknown}, which are not among the spaces {list(self.spaces)}")
        missing = [name for name in self.spaces if name not in self._sampling_order]
        if missing:
            logger.warning("Dict: sampling_order lacks %s; they are sampled last", missing)
            self._sampling_order += missing
        self._init_value = self.init_value
        self._value: dict[str, Any] = self._init_value

    @property
    def init_value(self) -> dict[str, Any]:
        """Initial values of all spaces; a sample of those that keep none."""
        values: dict[str, Any] = {}
        for name, space in _inner(self).items():
            if hasattr(space, "init_value"):
                values[name] = space.init_value
            else:
                logger.warning("Dict: the space `%s` has no init_value; a sample takes its place", name)
                values[name] = space.sample()
        return values

    @property
    def value(self) -> dict[str, Any]:
        """Present values of all spaces."""
        values: dict[str, Any] = {}
        for name, space in _inner(self).items():
            if not hasattr(space, "value"):
                raise ValueError(
                    f"the space `{name}` of type {type(space).__name__} does not have value property; use the class of this module"
                )
            values[name] = space.value
        return values

    def _get_sampling_order(self, parts: tuple[str, ...] = ()) -> Iterator[str]:
        """Dotted names of all spaces, dictionaries before their contents, in the order of sampling."""
        for name in self._sampling_order:
            if name not in self.spaces:
                continue
            path = (*parts, str(name))
            yield ".".join(path)
            space = _inner(self)[name]
            if isinstance(space, Dict):
                yield from space._get_sampling_order(path)
            elif _is_dict(space):
                yield from (".".join((*path, inner)) for inner in _inner(space))

    @property
    def sampling_order(self) -> list[str]:
        """Dotted names of all spaces in the order of sampling."""
        return list(self._get_sampling_order())

    def names(self) -> list[str]:
        """Dotted names of the leaves."""
        return [name for name, _ in _leaves(self)]

    def reset(self) -> None:
        """Return all spaces to their initial values."""
        for space in _inner(self).values():
            if hasattr(space, "reset"):
                space.reset()
        self._value = self.init_value

    def contains(self, x: Any) -> bool:
        """Whether ``x`` is a dict with a valid value for each space, which together satisfy the constraint."""
        if not isinstance(x, dict):
            return False
        valid = all(name in x and space.contains(x[name]) for name, space in self.spaces.items())
        return valid and bool(self.constrain_fn(x))

    def check(self, debug: bool = False) -> bool:
        """Whether the present values are valid. ``debug`` logs the first that is not."""
        for name, space in _inner(self).items():
            if hasattr(space, "check") and not space.check():
                if debug:
                    logger.warning("Dict: the value of `%s` is not valid", name)
                return False
        return True

    def sample(
        self,
        mask: Any | None = None,
        probability: Any | None = None,
        *,
        max_tries: int = 1000,
        warn_after_s: float | None = 5.0,
        set_value: bool = True,
    ) -> dict[str, Any]:
        """Sample all spaces, in the order of sampling, until the values satisfy the constraint.

        Raises:
            RuntimeError: ``max_tries`` samples did not satisfy the constraint.
        """

        def draw() -> dict[str, Any]:
            values: dict[str, Any] = {}
            for name in self._sampling_order:
                space = _inner(self)[name]
                held: dict[str, Any] = {"set_value": set_value} if isinstance(space, (_Valued, Dict)) else {}
                inner = [
                    cast("dict[str, Any]", of).get(name) if isinstance(of, dict) else None for of in (mask, probability)
                ]
                values[name] = space.sample(*inner, **held)
            return values

        value: dict[str, Any] = _until_valid(draw, self.contains, "Dict", max_tries, warn_after_s)
        if set_value:
            self._value = value
        return value

    def _at(self, name: str) -> Any:
        """The space with this dotted name."""
        space: Any = self
        for part in name.split("."):
            inner = _inner(space) if _is_dict(space) else {}
            if part not in inner:
                raise ValueError(f"the key {name} was not found in the Dict space; it has {', '.join(self.names())}")
            space = inner[part]
        return space

    def update(self, keys: Iterable[str]) -> None:
        """Sample the spaces with these dotted names anew: leaves, whole dictionaries, or ``all``."""
        wanted = set(keys)
        if wanted == {"all"}:
            self.sample()
        else:
            order = self.sampling_order
            for name in [name for name in order if name in wanted] + sorted(wanted.difference(order)):
                self._at(name).sample()
        assert self.check(debug=True), (
            "the sampled values do not go together; sample the factors of one constraint together"
        )

    def set_init_value(self, variations_values: Mapping[str, Any]) -> None:
        """Change initial values, by dotted names."""
        for name, value in variations_values.items():
            self._at(name).set_init_value(value)

    def set_value(self, variations_values: Mapping[str, Any]) -> None:
        """Change present values, by dotted names."""
        for name, value in variations_values.items():
            self._at(name).set_value(value)

    def to_str(self) -> str:
        """The names and spaces, indented."""

        def lines(space: spaces.Dict, depth: int) -> Iterator[str]:
            for name, inner in _inner(space).items():
                if _is_dict(inner):
                    yield f"{'    ' * depth}{name}:"
                    yield from lines(inner, depth + 1)
                else:
                    yield f"{'    ' * depth}{name}: {inner}"

        return "\n".join(lines(self, 0))


def _leaves(space: spaces.Dict, prefix: str = "") -> Iterator[tuple[str, spaces.Space[Any]]]:
    """Dotted names and spaces of the leaves."""
    for name, inner in _inner(space).items():
        if _is_dict(inner):
            yield from _leaves(inner, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", inner


def reset_variation_space(
    variation_space: Dict,
    seed: int | None = None,
    options: Mapping[str, Any] | None = None,
    default_variations: Sequence[str] | None = None,
) -> None:
    """Reset a variation space as an environment's ``reset`` does: initial values, then sampled ones, then given ones.

    Args:
        variation_space: The factors.
        seed: Seeds the sampling.
        options: ``variation``: names to sample; ``variation_values``: values by name.
        default_variations: Names to sample if ``options`` has no ``variation``.
    """
    variation_space.seed(seed)
    variation_space.reset()
    given = options or {}
    names: Any = given.get("variation", default_variations or ())
    if not isinstance(names, Sequence):
        raise ValueError(f"the variation option must be a Sequence of names, found {type(names).__name__}")
    variation_space.update([names] if isinstance(names, str) else cast("Sequence[str]", names))
    variation_space.set_value(given.get("variation_values", {}))
    assert variation_space.check(debug=True), "the values of variation_values do not go together"


def variation_space(spec: Mapping[str, Any]) -> Dict:
    """The factors of an environment, from its description (``_swm.World.spec_json``), with their defaults as values."""
    root: dict[str, Any] = {}
    for factor in spec["factors"]:
        *groups, name = factor["name"].split(".")
        inner = root
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[name] = _leaf(factor["space"], factor["default"])

    def build(tree: dict[str, Any]) -> Dict:
        return Dict(
            {name: build(cast("dict[str, Any]", inner)) if isinstance(inner, dict) else inner for name, inner in tree.items()}
        )

    return build(root)


def show_values(space: Dict, infos: Mapping[str, Any], row: int) -> None:
    """Make the factors of one environment, columns ``variation.*`` of ``infos``, the values of its variation space."""
    for name, leaf in _leaves(space):
        column = infos.get(f"variation.{name}")
        if column is not None and isinstance(leaf, _Valued):
            value = np.array(column[row, 0])
            leaf._value = int(value) if isinstance(leaf, Discrete) else value  # pyright: ignore[reportPrivateUsage]


def _leaf(space: Mapping[str, Any], default: Any) -> spaces.Space[Any]:
    kind = space["kind"]
    if kind == "rgb":
        return RGBBox(init_value=np.array(default, np.uint8))
    if kind == "discrete":
        return Discrete(space["n"], start=space["start"], init_value=int(default))
    if kind == "multi_discrete":
        return MultiDiscrete(space["n"], start=space["start"], init_value=np.array(default, np.int64))
    low, high, shape, dtype = _bounds(space)
    return Box(low, high, shape=shape, dtype=dtype, init_value=np.array(default, dtype).reshape(shape))


_DTYPES: dict[str, Any] = {
    "bool": np.bool_,
    "u8": np.uint8,
    "i32": np.int32,
    "i64": np.int64,
    "f32": np.float32,
    "f64": np.float64,
}


def _bounds(space: Mapping[str, Any]) -> tuple[npt.NDArray[Any], npt.NDArray[Any], tuple[int, ...], Any]:
    """Bounds, shape and dtype of a box; JSON has null for an infinite bound."""
    dtype, shape = _DTYPES[space["dtype"]], tuple(space["shape"])
    low = np.array([-np.inf if value is None else value for value in space["low"]], dtype).reshape(shape)
    high = np.array([np.inf if value is None else value for value in space["high"]], dtype).reshape(shape)
    return low, high, shape, dtype


def action_space(spec: Mapping[str, Any]) -> spaces.Space[Any]:
    """Gymnasium's space of one action, from an environment's description."""
    space = spec["action"]
    if space["kind"] == "discrete":
        return spaces.Discrete(space["n"], start=space["start"])
    if space["kind"] == "multi_discrete":
        return spaces.MultiDiscrete(space["n"], start=space["start"])
    low, high, shape, dtype = _bounds(space)
    return spaces.Box(low, high, shape=shape, dtype=dtype)


def observation_space(spec: Mapping[str, Any]) -> spaces.Dict:
    """Gymnasium's space of one observation: the environment's step columns, without axes for environments and time.

    A column of one number per step has the shape ``(1,)``.
    """
    found: dict[str, spaces.Space[Any]] = {}
    for field in spec["fields"]:
        if field["kind"] != "step" or field["dtype"] == "str":
            continue
        # Scalars are vectors of one element: libraries index the first axis of an observation.
        shape, dtype = tuple(field["shape"]) or (1,), _DTYPES[field["dtype"]]
        if dtype in (np.float32, np.float64):
            found[field["name"]] = spaces.Box(-np.inf, np.inf, shape, dtype)
        elif dtype is np.bool_:
            found[field["name"]] = spaces.Box(0, 1, shape, np.int8)
        else:
            info = np.iinfo(dtype)
            found[field["name"]] = spaces.Box(info.min, info.max, shape, dtype)
    return spaces.Dict(found)
