"""Columns, images and actions as models want them, and what is asked of models and settings before they are used."""

from __future__ import annotations

import difflib
import inspect
import logging
import weakref
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from ._arrays import Array, is_array, is_tensor, require_torch
from ._swm import PlanError

__all__ = [
    "observed_columns",
    "plan_bounds",
    "refuse_misspelled",
    "require_columns",
    "require_method",
    "require_settings",
    "scale",
    "setting_of",
    "transform",
    "unscale",
    "with_note",
]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")

_GOAL = "goal"


def _names_of(column: str) -> tuple[str, ...]:
    """The names that a setting of a column may have, the nearest first: a goal's is that of what it is the goal of."""
    if column == _GOAL:
        return (column, "goal_pixels", "pixels")
    return (column, column.removeprefix("goal_")) if column.startswith("goal_") else (column,)


def setting_of(settings: Mapping[str, Any], column: str) -> str | None:
    """The name in ``settings`` that applies to a column: its own or, for ``goal_x``, that of ``x``; None: nothing does."""
    return next((name for name in _names_of(column) if name in settings), None)


def require_columns(settings: Mapping[str, Mapping[str, Any]], infos: Mapping[str, Any]) -> None:
    """Refuses settings of columns that there are not: a misspelled one would do nothing.

    Args:
        settings: By argument, such as ``process``, what was given by column.
        infos: The columns. That of ``action`` may be missing, and that of a goal whose observation is there.

    Raises:
        ValueError: It names the column, what it may have been meant for, and those that there are.
    """
    for argument, of_columns in settings.items():
        for column in of_columns:
            if column == "action" or any(name in infos for name in _names_of(column)):
                continue
            known = [name for name in infos if not name.startswith("_")]
            near = difflib.get_close_matches(column, known, 1)
            hint = f" (did you mean {near[0]!r}?)" if near else ""
            if column in ("pixels", _GOAL):
                hint = " (images need image_shape=(H, W) of World or make_manifest)"
            raise ValueError(f"{argument} names {column!r}, which is no column{hint}; the columns are {', '.join(known)}")


def refuse_misspelled(of: type, given: Mapping[str, Any]) -> None:
    """Refuses keyword arguments that would become attributes and are nearly the name of a setting.

    Raises:
        TypeError: It names the setting.
    """
    settings = {
        name
        for base in of.__mro__
        if "__init__" in vars(base) and base is not object
        for name in inspect.signature(base.__init__).parameters  # type: ignore[misc]
        if name not in ("self", "args", "kwargs")
    }
    for name in given:
        near = difflib.get_close_matches(name, settings - {name}, 1, 0.8)
        if near and name not in settings:
            raise TypeError(f"{of.__name__} has no argument {name!r}; did you mean {near[0]!r}?")


def require_settings(process: Mapping[str, Any] | None, transforms: Mapping[str, Any] | None) -> None:
    """Refuses scalings that do not scale and transforms that cannot be called."""
    for name, scaler in (process or {}).items():
        if isinstance(scaler, type) or not hasattr(scaler, "transform"):
            raise TypeError(
                f"process[{name!r}] is {scaler!r}; give an object with transform and inverse_transform, such as a StandardScaler"
            )
    for name, function in (transforms or {}).items():
        if not callable(function):
            raise TypeError(f"transform[{name!r}] is {function!r}; give a function of one image, (C, H, W)")


def require_method(of: str, model: Any, method: str, needed: str, hint: str) -> None:
    """Refuses a model or cost without a method, when it is given and not when a long run first calls it.

    Args:
        of: Who is given it.
        model: The model or cost.
        method: The name of the method.
        needed: The method's arguments and result, for the message.
        hint: What else the caller may have meant.
    """
    if isinstance(model, type):
        raise TypeError(f"{of} was given the class {model.__name__}; make an object of it: {model.__name__}(…)")
    if not callable(getattr(model, method, None)):
        raise TypeError(f"{of} was given {type(model).__name__}, which has no {needed}; {hint}")


def observed_columns(env: Any) -> tuple[str, ...]:
    """The columns that environments observe, by their space of observations; none where they do not say."""
    space = getattr(env, "single_observation_space", None)
    if space is None:
        return ()
    return tuple(getattr(space, "spaces", None) or ("observation", "pixels"))


@contextmanager
def with_note(infos: Mapping[str, Any], transforms: Mapping[str, Any]) -> Generator[None]:
    """Adds to an error of a model that it was given images as the World has them, which few models take."""
    try:
        yield
    except PlanError:
        raise  # It has its own fix.
    except Exception as error:
        raw = [
            column
            for column in ("pixels", _GOAL)
            if setting_of(transforms, column) is None and str(getattr(infos.get(column), "dtype", "")).endswith("uint8")
        ]
        if raw and hasattr(error, "add_note"):
            shape = tuple(infos[raw[0]].shape[-3:])
            error.add_note(
                f"without a transform, the model is given {' and '.join(raw)} as the World has them: uint8, (…, H, W, C) with "
                f"(H, W, C) = {shape}. For float images with the channels first: "
                'transform={"pixels": lambda image: image.float() / 255}, which applies to the goal, too'
            )
        raise


def plan_bounds(space: Any, scaler: Any) -> tuple[tuple[Array, Array], tuple[Array, Array]] | None:
    """The bounds of actions, in units of the environment and of plans; None where there are none.

    Args:
        space: The space of one environment's action, ``(*A)``.
        scaler: That of ``process["action"]``, element by element; None: plans are in units of the environment.

    Returns:
        ``(low, high)`` of the space's shape and type, and ``(low, high)``, ``(A,)`` f64, of plans.
    """
    low, high = getattr(space, "low", None), getattr(space, "high", None)
    if low is None or high is None or not np.issubdtype(np.asarray(low).dtype, np.floating):
        return None
    both = np.stack([np.asarray(low, np.float64).reshape(-1), np.asarray(high, np.float64).reshape(-1)])
    if not np.isfinite(both).any():
        return None
    if scaler is None:
        return (low, high), (both[0], both[1])
    finite = np.isfinite(both)
    safe = cast("npt.NDArray[np.float64]", np.where(finite, both, 0.0))
    # A third row takes its elements from both in turn: a scaling of each element by itself gives what it gave there.
    is_first = np.arange(len(safe[0])) % 2 == 0
    mixed = cast("npt.NDArray[np.float64]", np.where(is_first, safe[0], safe[1]))
    planned = np.asarray(scale(scaler, "action", np.stack([*safe, mixed])), np.float64)
    if not np.isfinite(planned).all():
        raise ValueError(f"{type(scaler).__name__} in process['action'] gives values that are not finite; fit it without NaN")
    if not np.allclose(planned[2], cast("npt.NDArray[np.float64]", np.where(is_first, planned[0], planned[1]))):
        raise ValueError(
            f"{type(scaler).__name__} in process['action'] mixes the elements of an action, so that plans have no bounds of "
            "their own; give PlanConfig(clip_actions=False), or scale each element by itself"
        )
    # A negative scale swaps the bounds.
    ends = np.sort(np.where(finite, planned[:2], both), axis=0)
    return (low, high), (ends[0], ends[1])


def scale(scaler: Any, key: str, values: Any) -> Array:
    """Values ``(..., D)`` scaled row by row; blocks of several actions action by action.

    Raises:
        ValueError: The scaler is of rows of another length, or gives other shapes than it is given.
    """
    if not is_array(values):
        raise ValueError(
            f"Expected numpy array for key '{key}' in process, got {type(values)}; leave tensors out of process"
        )
    dim = _fitted_dim(scaler)
    if dim is not None and values.ndim > 1 and values.shape[-1] != dim and values.shape[-1] % dim == 0:
        rows = values.reshape(-1, dim)
    else:
        rows = values.reshape(-1, *values.shape[2:]) if values.ndim > 2 else values
    if dim is not None and rows.ndim > 1 and rows.shape[-1] != dim:
        raise ValueError(
            f"{type(scaler).__name__} in process[{key!r}] was fitted on rows of {dim} values, and {key} has {list(values.shape)}, rows of "
            f"{values.shape[-1]}; fit it on the column {key!r} of the dataset of this environment"
        )
    scaled = scaler.transform(rows)
    scaled = scaled.detach().cpu().numpy() if is_tensor(scaled) else np.asarray(scaled)
    if scaled.size != values.size:
        raise ValueError(
            f"{type(scaler).__name__} in process[{key!r}] gave {list(scaled.shape)} of {list(rows.shape)}; a scaler keeps the shape of what it is given"
        )
    return scaled.reshape(values.shape)


def unscale(scaler: Any, actions: Array) -> Array:
    """Plans in units of the environment, of the same shape."""
    found = scaler.inverse_transform(actions)
    found = found.detach().cpu().numpy() if is_tensor(found) else np.asarray(found)
    if found.shape != actions.shape:
        raise ValueError(
            f"{type(scaler).__name__}.inverse_transform in process['action'] gave {list(found.shape)} of actions [N, *A] = {list(actions.shape)}; a scaler "
            "keeps the shape of what it is given"
        )
    return found


def _fitted_dim(scaler: Any) -> int | None:
    """How long the rows are that a scaler was fitted on; None where it does not tell, or takes any."""
    dim = getattr(scaler, "n_features_in_", None)
    if dim is None:
        sizes = {np.shape(getattr(scaler, name, None))[-1:] for name in ("mean", "std", "low", "high")}
        sizes = {size[0] for size in sizes if size and size[0] > 1}
        dim = sizes.pop() if len(sizes) == 1 else None
    return None if dim is None else int(dim)


def transform(function: Callable[[Any], Any], key: str, values: Any) -> Any:
    """A transform applied to every image of ``(N, T, H, W, C)``: ``(N, T, C, H, W)``, or what it makes of them.

    Raises:
        TypeError: It returned what is no image.
        ValueError: Its images differ in shape.
    """
    leading = values.shape[:2] if values.ndim > 2 else values.shape[:1]
    flat = values.reshape(-1, *values.shape[len(leading) :])
    if key.startswith(("pixels", "goal")) and flat.ndim == 4:
        flat = flat.permute(0, 3, 1, 2) if is_tensor(flat) else np.ascontiguousarray(flat.transpose(0, 3, 1, 2))
    torch = require_torch("transforms of images take torch tensors")
    images = flat if is_tensor(flat) else torch.from_numpy(flat)
    try:
        as_image: Any = import_module("torchvision.tv_tensors").Image
    except ImportError:  # Transforms of torchvision know a tensor for an image, too.
        as_image = torch.as_tensor
    made = [_one_image(function, key, as_image(image)) for image in images]
    shapes = [list(image.shape) for image in made]
    if odd := next((index for index, shape in enumerate(shapes) if shape != shapes[0]), None):
        raise ValueError(
            f"transform[{key!r}] made {shapes[0]} of image 0 and {shapes[odd]} of image {odd}; all images of a batch have one shape: crop or "
            "resize to a fixed size"
        )
    _note_channels_last(function, key, list(images.shape[1:]), shapes[0] if shapes else [])
    stacked = torch.stack(made)
    return stacked.reshape(*leading, *stacked.shape[1:])


def _one_image(function: Callable[[Any], Any], key: str, image: Any) -> Any:
    """What a transform makes of one image, as a tensor on the CPU or where it put it."""
    told = f"transform[{key!r}] is given one image at a time: [C, H, W] = {list(image.shape)}, {str(image.dtype).removeprefix('torch.')}, on the CPU"
    try:
        made = function(image)
    except Exception as error:
        if hasattr(error, "add_note"):
            error.add_note(f"{told}; for a batch or a video of images, add axes of length 1 and remove them: function(image[None])[0]")
        raise
    if made is None:
        raise TypeError(f"{told}, and returned None; return the image: a function that changes it in place still needs `return`")
    try:
        made = require_torch("transforms of images").as_tensor(np.asarray(made) if hasattr(made, "getbands") else made)
    except (TypeError, ValueError, RuntimeError) as error:
        raise TypeError(f"{told}, and returned {type(made).__name__}; return a tensor or an array [C, H, W] ({error})") from error
    return made.detach()


# Transforms that were noted: once each.
_noted: weakref.WeakSet[Any] = weakref.WeakSet()


def _note_channels_last(function: Any, key: str, given: list[int], made: list[int]) -> None:
    """Warns of a transform that moves the channels to the end, where models of torch do not expect them."""
    if len(made) != 3 or len(given) != 3 or made[-1] != given[0] or made[0] == given[0] or function in _noted:
        return
    with suppress(TypeError):  # Not everything that can be called can be referred to weakly.
        _noted.add(function)
    logger.warning(
        "transform[%r] returned images %s of images %s: [H, W, C] where it was given [C, H, W]; convolutions and vision transformers of torch "
        "take [C, H, W]: leave out its permute or transpose(1, 2, 0)",
        key,
        made,
        given,
    )
