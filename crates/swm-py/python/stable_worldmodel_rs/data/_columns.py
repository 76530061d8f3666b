"""Episodes as users give them, as flat columns of numbers and text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from .._arrays import is_array

__all__ = ["flattened", "refuse_objects"]

_NUMBERS = (bool, int, float, complex, np.generic)
_TEXTS = (str, bytes, bytearray)


def flattened(episode: Mapping[Any, Any], prefix: str = "") -> dict[str, Any]:
    """An episode by dotted names: dicts of columns, and dicts of each step, by their keys, as recordings of environments have them.

    Raises:
        TypeError: A name is no text, or the dicts of two steps have other keys.
    """
    found: dict[str, Any] = {}
    for key, values in episode.items():
        if not isinstance(key, str):
            raise TypeError(f"the column {prefix}{key!r} has a name that is {type(key).__name__}; names of columns are text")
        name = f"{prefix}{key}"
        if isinstance(values, Mapping):
            found |= flattened(cast("Mapping[Any, Any]", values), f"{name}.")
        elif isinstance(values, (list, tuple)) and values and all(isinstance(value, Mapping) for value in cast("Sequence[Any]", values)):
            found |= flattened(_by_key(name, cast("Sequence[Mapping[Any, Any]]", values)), f"{name}.")
        else:
            found[name] = values
    return found


def _by_key(name: str, steps: Sequence[Mapping[Any, Any]]) -> dict[Any, list[Any]]:
    """The dicts of T steps as lists of T values."""
    first = steps[0].keys()
    for number, step in enumerate(steps):
        if step.keys() != first:
            differing = sorted(map(str, step.keys() ^ first))
            raise TypeError(
                f"column {name!r}: the dict of step {number} has other keys than that of step 0 ({', '.join(differing)}); give every step "
                "the same keys, with NaN or '' where there is no value"
            )
    return {key: [step[key] for step in steps] for key in first}


def refuse_objects(name: str, values: Any, steps: Sequence[Any]) -> None:
    """Refuses values that NumPy would keep as objects, or turn into text that was none.

    Args:
        name: The column.
        values: All of it; of a list, see ``steps``.
        steps: The values of each step, of a list.

    Raises:
        TypeError: It names the step and the kind of its value.
    """
    if isinstance(values, (set, frozenset)) or (not isinstance(values, list) and not steps and _is_object(values)):
        raise TypeError(_refused(name, values, ""))
    texts = next((step for step, value in enumerate(steps) if isinstance(value, _TEXTS)), None)
    for step, value in enumerate(steps):
        if _is_object(value):
            raise TypeError(_refused(name, value, f" at step {step}"))
        if texts is not None and isinstance(value, _NUMBERS) and not isinstance(value, (np.str_, np.bytes_)):
            raise TypeError(
                f"column {name!r} holds text at step {texts} and {_kind(value)} at step {step}; give numbers at every step, or "
                "text at every step: str(value)"
            )


def _is_object(value: Any) -> bool:
    """Whether it is no number, text, array, tensor, image, nor a list of some."""
    if isinstance(value, (*_NUMBERS, *_TEXTS)) or hasattr(value, "detach") or hasattr(value, "__array_interface__"):
        return False
    if is_array(value):
        # Of text of any length; what is in it shows where it is taken apart.
        return False
    if isinstance(value, (list, tuple)):
        return any(_is_object(one) for one in cast("Sequence[Any]", value))
    return not hasattr(value, "__array__")


def _refused(name: str, value: Any, where: str) -> str:
    if value is None:
        return (
            f"column {name!r} is None{where}; leave the column out, or give what stands for a missing value: NaN for floats, -1 for "
            "integers, '' for text"
        )
    fix = "give it as numbers or as text, such as json.dumps(value) or str(value), or leave the column out"
    if isinstance(value, Mapping):
        fix = "give a dict at every step, which becomes a column per key, or leave the column out"
    return f"column {name!r} holds {_kind(value)}{where}, and datasets hold numbers and text; {fix}"


def _kind(value: object) -> str:
    return type(value).__name__
