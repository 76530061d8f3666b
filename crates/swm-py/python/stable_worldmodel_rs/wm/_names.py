"""Names of a vision transformer's tensors: of transformers 4, of transformers 5, and of facebookresearch/dinov2. Without torch."""

from __future__ import annotations

import re
from collections.abc import Iterable

__all__ = ["generation", "of_generation"]

# transformers 4, transformers 5.
_ATTENTION = (
    ("attention.attention.query.", "attention.q_proj."),
    ("attention.attention.key.", "attention.k_proj."),
    ("attention.attention.value.", "attention.v_proj."),
    ("attention.output.dense.", "attention.o_proj."),
)
_MLP = (("intermediate.dense.", "mlp.fc1."), ("output.dense.", "mlp.fc2."))
_LAYER = re.compile(r"(?:encoder\.layer|layers)\.(\d+)\.(.*)")


def of_generation(name: str, names: int, dinov2: bool) -> str:
    """The name of an encoder's tensor in transformers 4 or 5, from that of either. DINOv2 keeps its ``encoder.layer`` in both."""
    found = _LAYER.fullmatch(name)
    if found is None:
        return name
    number, rest = found.groups()
    for four, five in _ATTENTION if dinov2 else _ATTENTION + _MLP:
        theirs, ours = (five, four) if names == 4 else (four, five)
        if rest.startswith(theirs):
            rest = ours + rest[len(theirs) :]
            break
    home = "layers" if names == 5 and not dinov2 else "encoder.layer"
    return f"{home}.{number}.{rest}"


def generation(names: Iterable[str]) -> int:
    """The version of transformers whose names these are; 5 where they tell nothing."""
    return 4 if any(".attention.attention.query." in name for name in names) else 5
