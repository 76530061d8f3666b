"""Vision transformers without pooling: the ViT and the DINOv2 of transformers, in the names of its version 4 or 5.

Files differ in the names of these tensors. A network has those of the file that it is made for (``names``), and reads both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, NamedTuple

from ._names import of_generation
from ._nets import join_heads, split_heads
from ._torch import F, Tensor, nn, torch

__all__ = ["KNOWN", "USUAL_HEADS", "Encoded", "Vit", "VitSizes", "vit_hf", "without_fixed"]


@dataclass(frozen=True)
class VitSizes:
    """What a vision transformer is made of.

    Attributes:
        dim: Of a token.
        depth: Blocks.
        heads: Of attention; they divide ``dim``.
        hidden: Dim inside of the MLPs.
        patch: Side of a patch in pixels.
        positions_for: Side in pixels of the images that the table of positions is for; other sizes interpolate it.
        dinov2: DINOv2's form: epsilon 1e-6 in place of 1e-12, and a learned scale on each branch.
        names: Of tensors: 4 or 5, the version of transformers.
        mask_token: Whether files have a token for masked patches. Nothing here uses it.
        pooler: Whether files have a layer behind the summary token, as ViTs of transformers do. Nothing here uses it.
    """

    dim: int = 192
    depth: int = 12
    heads: int = 3
    hidden: int = 768
    patch: int = 14
    positions_for: int = 224
    dinov2: bool = False
    names: int = 5
    mask_token: bool = False
    pooler: bool = False

    @property
    def grid(self) -> int:
        """Patches of a side of the table of positions."""
        return self.positions_for // self.patch


_EPSILON = {False: 1e-12, True: 1e-6}
_DINOV2 = VitSizes(positions_for=518, dinov2=True, mask_token=True)
_PUBLISHED = {
    "dinov2-small": replace(_DINOV2, dim=384, heads=6, hidden=1536),
    "dinov2-base": replace(_DINOV2, dim=768, heads=12, hidden=3072),
    "dinov2-large": replace(_DINOV2, dim=1024, depth=24, heads=16, hidden=4096),
}
KNOWN: dict[str, VitSizes] = {name: sizes for short, sizes in _PUBLISHED.items() for name in (f"facebook/{short}", short.replace("-", "_"))}
"""DINOv2 encoders whose sizes are known by their names: repositories, and the reference's short names, which its training script writes into configs."""

_SIZES = {"tiny": (192, 12, 3, 768), "small": (384, 12, 6, 1536), "base": (768, 12, 12, 3072), "large": (1024, 24, 16, 4096)}
USUAL_HEADS: dict[int, int] = {dim: heads for dim, _, heads, _ in _SIZES.values()}
"""Heads of the published encoders of a width, in ``swm import``, too."""

# Settings of transformers that have one value here, for either form.
_FIXED: dict[str, Any] = {
    "hidden_act": "gelu",
    "qkv_bias": True,
    "num_channels": 3,
    "hidden_dropout_prob": 0.0,
    "attention_probs_dropout_prob": 0.0,
    "drop_path_rate": 0.0,
    "use_swiglu_ffn": False,
}


def without_fixed(settings: Mapping[str, Any], dinov2: bool, place: str) -> dict[str, Any]:
    """The settings of an encoder without those that have one value here.

    Args:
        settings: By the names of transformers.
        dinov2: Its form, on which epsilon depends.
        place: What errors put in front of a name.

    Raises:
        ValueError: one of them has another value.
    """
    fixed = {**_FIXED, "layer_norm_eps": _EPSILON[dinov2]}
    for name, wanted in fixed.items():
        if name in settings and settings[name] != wanted:
            raise ValueError(f"{place}{name} is {settings[name]!r}, and encoders have {wanted!r} here; load such a model with the reference")
    return {name: value for name, value in settings.items() if name not in fixed}


# Where a block keeps what, by form and version.
_FIVE = {"q": "attention.q_proj", "k": "attention.k_proj", "v": "attention.v_proj", "o": "attention.o_proj"}
_FOUR = {name: f"attention.attention.{long}" for name, long in (("q", "query"), ("k", "key"), ("v", "value"))}
_FOUR["o"] = "attention.output.dense"
_NORMS = {"norm1": "layernorm_before", "norm2": "layernorm_after"}
_MLP = {"fc1": "mlp.fc1", "fc2": "mlp.fc2"}
_DINO = {"norm1": "norm1", "norm2": "norm2", **_MLP, "scale1": "layer_scale1", "scale2": "layer_scale2"}
_PLACES: dict[tuple[bool, int], dict[str, str]] = {
    (False, 4): {**_FOUR, **_NORMS, "fc1": "intermediate.dense", "fc2": "output.dense"},
    (False, 5): {**_FIVE, **_NORMS, **_MLP},
    (True, 4): {**_FOUR, **_DINO},
    (True, 5): {**_FIVE, **_DINO},
}


def _plant(root: Any, path: str, module: nn.Module) -> None:
    """Makes ``module`` the submodule of that path."""
    *above, last = path.split(".")
    for name in above:
        if not hasattr(root, name):
            setattr(root, name, nn.Module())
        root = getattr(root, name)
    setattr(root, last, module)


class Encoded(NamedTuple):
    """What an encoder makes of images."""

    last_hidden_state: Tensor
    """``(N, 1 + P, dim)``: the summary token, then the patches row by row."""


class _Scale(nn.Module):
    def __init__(self, dim: int) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.lambda1: Tensor = nn.Parameter(torch.ones(dim))

    def forward(self, x: Tensor) -> Tensor:
        return x * self.lambda1


class _Layer(nn.Module):
    """Attention and MLP, each behind a layer norm and beside a residual."""

    def __init__(self, sizes: VitSizes) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self._heads = sizes.heads
        places = _PLACES[sizes.dinov2, sizes.names]
        self._paths = {name: path.split(".") for name, path in places.items()}
        dim, epsilon = sizes.dim, _EPSILON[sizes.dinov2]
        parts: dict[str, nn.Module] = {name: nn.Linear(dim, dim) for name in "qkvo"}
        parts |= {"fc1": nn.Linear(dim, sizes.hidden), "fc2": nn.Linear(sizes.hidden, dim)}
        parts |= {name: nn.LayerNorm(dim, eps=epsilon) for name in ("norm1", "norm2")}
        if sizes.dinov2:
            parts |= {"scale1": _Scale(dim), "scale2": _Scale(dim)}
        for name, path in places.items():
            _plant(self, path, parts[name])

    def _at(self, name: str, x: Tensor) -> Tensor:
        """Looked up each time: what a user puts in the place of a layer is what is used."""
        path = self._paths.get(name)
        return x if path is None else reduce(getattr, path, self)(x)

    def forward(self, x: Tensor) -> Tensor:
        seen = self._at("norm1", x)
        q, k, v = (split_heads(self._at(name, seen), self._heads) for name in "qkv")
        attended = self._at("o", join_heads(F.scaled_dot_product_attention(q, k, v)))
        x = x + self._at("scale1", attended)
        hidden = F.gelu(self._at("fc1", self._at("norm2", x)))
        return x + self._at("scale2", self._at("fc2", hidden))


class _Projection(nn.Module):
    def __init__(self, sizes: VitSizes) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.projection: nn.Module = nn.Conv2d(3, sizes.dim, kernel_size=sizes.patch, stride=sizes.patch)


class _Embeddings(nn.Module):
    """Patches as tokens, with their positions, behind the summary token."""

    def __init__(self, sizes: VitSizes) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.cls_token: Tensor = nn.Parameter(torch.zeros(1, 1, sizes.dim))
        if sizes.mask_token:
            shape = (1, sizes.dim) if sizes.dinov2 else (1, 1, sizes.dim)
            self.mask_token: Tensor = nn.Parameter(torch.zeros(*shape))
        self.position_embeddings: Tensor = nn.Parameter(torch.zeros(1, 1 + sizes.grid**2, sizes.dim))
        self.patch_embeddings: nn.Module = _Projection(sizes)

    def forward(self, images: Tensor) -> Tensor:
        embed: Any = self.patch_embeddings
        patches = embed.projection(images)
        grid = patches.shape[-2:]
        tokens = torch.cat([self.cls_token.expand(len(images), -1, -1), patches.flatten(2).transpose(1, 2)], dim=1)
        return tokens + self._positions(grid[0], grid[1]).to(tokens.dtype)

    def _positions(self, rows: int, columns: int) -> Tensor:
        table: Any = self.position_embeddings
        side = round((table.shape[1] - 1) ** 0.5)
        if (rows, columns) == (side, side):
            return table
        grid = table[:, 1:].unflatten(1, (side, side)).permute(0, 3, 1, 2).float()
        grid = F.interpolate(grid, size=(rows, columns), mode="bicubic", align_corners=False)
        return torch.cat([table[:, :1].float(), grid.flatten(2).transpose(1, 2)], dim=1)


class Vit(nn.Module):
    """A vision transformer: images ``(N, 3, H, W)`` to tokens, ``last_hidden_state``."""

    def __init__(self, sizes: VitSizes) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        if sizes.heads < 1 or sizes.dim % sizes.heads:
            raise ValueError(f"encoder: {sizes.heads} heads do not divide a dim of {sizes.dim}; give another number of heads")
        self.sizes: VitSizes = sizes
        self.embeddings: nn.Module = _Embeddings(sizes)
        layers = nn.ModuleList([_Layer(sizes) for _ in range(sizes.depth)])
        self._layers = "layers" if not sizes.dinov2 and sizes.names == 5 else "encoder.layer"
        _plant(self, self._layers, layers)
        self.layernorm: nn.Module = nn.LayerNorm(sizes.dim, eps=_EPSILON[sizes.dinov2])
        if sizes.pooler:
            _plant(self, "pooler.dense", nn.Linear(sizes.dim, sizes.dim))
        self.apply(_initialize)
        for table in (self.embeddings.cls_token, self.embeddings.position_embeddings):
            nn.init.trunc_normal_(table, std=0.02)

    def forward(self, pixel_values: Tensor, interpolate_pos_encoding: bool = True) -> Encoded:
        """Images of any size of which a patch fits; positions are interpolated where the size is another one."""
        tokens = self.embeddings(pixel_values)
        root: Any = self
        layers = reduce(getattr, self._layers.split("."), root)
        for layer in layers:
            tokens = layer(tokens)
        return Encoded(self.layernorm(tokens))

    def _load_from_state_dict(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, state_dict: dict[str, Any], prefix: str, *rest: Any
    ) -> None:
        """Files of the other version are read, too."""
        below = {name: value for name, value in state_dict.items() if name.startswith(prefix)}
        for name, value in below.items():
            mine = prefix + of_generation(name[len(prefix) :], self.sizes.names, self.sizes.dinov2)
            if mine != name:
                del state_dict[name]
                state_dict[mine] = value
        parent: Any = super()
        parent._load_from_state_dict(state_dict, prefix, *rest)


def _initialize(module: Any) -> None:
    """Normal weights of a std of 0.02, cut at two stds, and biases of zero."""
    if isinstance(module, (nn.Linear, nn.Conv2d)):
        layer: Any = module
        nn.init.trunc_normal_(layer.weight, std=0.02)
        nn.init.zeros_(layer.bias)


def vit_hf(
    size: str = "tiny",
    patch_size: int = 16,
    image_size: int = 224,
    pretrained: bool = False,
    use_mask_token: bool = True,
    *,
    names: int = 5,
    hidden_size: int | None = None,
    num_hidden_layers: int | None = None,
    num_attention_heads: int | None = None,
    intermediate_size: int | None = None,
) -> Vit:
    """A ViT of random weights, of one of the sizes ``"tiny"``, ``"small"``, ``"base"`` and ``"large"`` or what differs from it.

    Raises:
        ValueError: ``pretrained``, which would fetch; or another ``size``.
    """
    if pretrained:
        raise ValueError("vit_hf(pretrained=True) would fetch weights; load them from a file, or train from random ones")
    if size not in _SIZES:
        raise ValueError(f"vit_hf: size {size!r} is none of {', '.join(_SIZES)}")
    dim, depth, heads, hidden = _SIZES[size]
    return Vit(
        VitSizes(
            dim=hidden_size or dim,
            depth=depth if num_hidden_layers is None else num_hidden_layers,
            heads=num_attention_heads or heads,
            hidden=intermediate_size or hidden,
            patch=patch_size,
            positions_for=image_size,
            names=names,
            mask_token=use_mask_token,
        )
    )
