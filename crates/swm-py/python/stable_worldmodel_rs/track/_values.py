"""Numbers and settings in the forms that trackers take."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias, cast

Values: TypeAlias = dict[str, Any]


def numbers(values: Mapping[str, Any]) -> dict[str, float]:
    """Numbers by name as floats: also numbers of NumPy, and tensors of one number.

    Raises:
        TypeError: A value is no number.
    """
    return {str(name): _number(str(name), value) for name, value in values.items()}


def _number(name: str, value: Any) -> float:
    if hasattr(value, "item"):
        try:
            value = value.item()
        except (RuntimeError, ValueError) as error:
            raise TypeError(f"{name}: more than one number; log its mean, or each by a name") from error
    if isinstance(value, (bool, int, float)):
        return float(value)
    raise TypeError(f"{name}: {type(value).__name__} is no number; settings go into config=")


def flat(config: Mapping[str, Any], before: str = "") -> Values:
    """Nested settings by dotted names; what is neither a number nor a text is a text."""
    found: Values = {}
    for name, value in config.items():
        key = f"{before}{name}"
        if isinstance(value, Mapping):
            found.update(flat(cast("Mapping[str, Any]", value), f"{key}."))
        elif value is None or isinstance(value, (bool, int, float, str)):
            found[key] = value
        else:
            found[key] = str(value)
    return found
