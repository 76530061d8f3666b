"""Names of a vision transformer's tensors: of transformers 4, of transformers 5, and of facebookresearch/dinov2. Without torch."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._torch import Tensor

__all__ = ["generation", "of_facebook", "of_generation"]

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


# facebookresearch/dinov2, transformers 5.
_FACEBOOK = (
    (r"cls_token|mask_token", r"embeddings.\g<0>"),
    (r"pos_embed", "embeddings.position_embeddings"),
    (r"patch_embed\.proj\.(.*)", r"embeddings.patch_embeddings.projection.\1"),
    (r"norm\.(.*)", r"layernorm.\1"),
    (r"blocks\.(\d+)\.attn\.proj\.(.*)", r"encoder.layer.\1.attention.o_proj.\2"),
    (r"blocks\.(\d+)\.ls(\d)\.gamma", r"encoder.layer.\1.layer_scale\2.lambda1"),
    (r"blocks\.(\d+)\.(.*)", r"encoder.layer.\1.\2"),
)
_JOINED = re.compile(r"blocks\.(\d+)\.attn\.qkv\.(.*)")


def of_facebook(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """A DINOv2's tensors under the names of transformers 5, where they have those of its authors: one matrix for q, k and v."""
    if "blocks.0.attn.qkv.weight" not in tensors:
        return dict(tensors)
    found: dict[str, Tensor] = {}
    for name, value in tensors.items():
        if (joined := _JOINED.fullmatch(name)) is not None:
            for part, third in zip("qkv", value.chunk(3), strict=True):
                found[f"encoder.layer.{joined[1]}.attention.{part}_proj.{joined[2]}"] = third
            continue
        matches = ((re.fullmatch(pattern, name), new) for pattern, new in _FACEBOOK)
        found[next((match.expand(new) for match, new in matches if match), name)] = value
    return found


def generation(names: Iterable[str]) -> int:
    """The version of transformers whose names these are; 5 where they tell nothing."""
    return 4 if any(".attention.attention.query." in name for name in names) else 5
