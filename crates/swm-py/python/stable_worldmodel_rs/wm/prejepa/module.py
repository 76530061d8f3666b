"""The predictor of PreJEPA (DINO-WM, arXiv 2411.04983): a transformer over the tokens of some frames, which see their own and
earlier frames."""

from __future__ import annotations

from typing import Any

from .._frames import Embedder, frame_mask
from .._nets import FeedForward, join_heads, split_heads
from .._torch import F, Tensor, nn, torch
from .._vit import KNOWN, Vit

__all__ = ["Attention", "CausalPredictor", "Embedder", "FeedForward", "Transformer", "create_backbone"]


def create_backbone(name: str) -> Vit:
    """A DINOv2 of that name, ``facebook/dinov2-small``, ``-base`` or ``-large``, of random weights: files of models hold their own.

    Raises:
        ValueError: another name.
    """
    if name not in KNOWN:
        raise ValueError(f"create_backbone: {name!r} is no encoder that is known here; known are {', '.join(KNOWN)}")
    return Vit(KNOWN[name])


class Attention(nn.Module):
    """Self-attention of tokens, to those of their own and earlier frames."""

    bias: Tensor

    def __init__(
        self, dim: int, heads: int = 8, dim_head: int = 64, dropout: float = 0.0, num_patches: int = 1, num_frames: int = 1
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        inner = heads * dim_head
        self.heads: int = heads
        self.dropout: float = dropout
        self.norm: nn.Module = nn.LayerNorm(dim)
        self.to_qkv: nn.Module = nn.Linear(dim, 3 * inner, bias=False)
        plain = heads == 1 and inner == dim
        self.to_out: nn.Module = nn.Identity() if plain else nn.Sequential(nn.Linear(inner, dim), nn.Dropout(dropout))
        # In files, and made again here: what a file has in its place is not read.
        self.register_buffer("bias", frame_mask(num_frames, num_patches, num_patches).float())

    def forward(self, x: Tensor) -> Tensor:
        """``(B, T × P, dim)`` to the same."""
        q, k, v = (split_heads(part, self.heads) for part in self.to_qkv(self.norm(x)).chunk(3, dim=-1))
        count = x.shape[1]
        mask = self.bias[:, :, :count, :count] > 0
        dropout = self.dropout if self.training else 0.0
        return self.to_out(join_heads(F.scaled_dot_product_attention(q, k, v, attn_mask=mask, dropout_p=dropout)))


class Transformer(nn.Module):
    """Blocks of attention and MLP, and a last norm."""

    def __init__(
        self,
        dim: int,
        depth: int,
        heads: int,
        dim_head: int,
        mlp_dim: int,
        dropout: float = 0.0,
        num_patches: int = 1,
        num_frames: int = 1,
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.norm: nn.Module = nn.LayerNorm(dim)
        self.layers: nn.ModuleList = nn.ModuleList()
        for _ in range(depth):
            pair = [Attention(dim, heads, dim_head, dropout, num_patches, num_frames), FeedForward(dim, mlp_dim, dropout)]
            self.layers.append(nn.ModuleList(pair))

    def forward(self, x: Tensor) -> Tensor:
        """``(B, T × P, dim)`` to the same."""
        pairs: Any = self.layers
        for attention, feed_forward in pairs:
            x = attention(x) + x
            x = feed_forward(x) + x
        return self.norm(x)


class CausalPredictor(nn.Module):
    """Predicts the tokens of the frame after each of ``num_frames``, at most, of ``num_patches`` tokens."""

    def __init__(
        self,
        *,
        num_patches: int,
        num_frames: int,
        dim: int,
        depth: int,
        heads: int,
        mlp_dim: int,
        pool: str = "cls",
        dim_head: int = 64,
        dropout: float = 0.0,
        emb_dropout: float = 0.0,
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.num_patches: int = num_patches
        self.num_frames: int = num_frames
        self.pool: str = pool
        self.pos_embedding: Tensor = nn.Parameter(torch.randn(1, num_frames * num_patches, dim))
        self.dropout: nn.Module = nn.Dropout(emb_dropout)
        self.transformer: nn.Module = Transformer(dim, depth, heads, dim_head, mlp_dim, dropout, num_patches, num_frames)

    def forward(self, x: Tensor) -> Tensor:
        """``(B, T × P, dim)`` to the same."""
        return self.transformer(self.dropout(x + self.pos_embedding[:, : x.shape[1]]))
