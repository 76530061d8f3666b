"""Transformers that look at frames and at a goal: policies, values, critics.

Blocks look at the frames and at the goal by turns; then each frame becomes one vector. Attributes have the names of the
reference's files. Shapes: B rows, T frames, P tokens of a frame, W dims of a token.
"""

from __future__ import annotations

from typing import Any

from .._frames import Embedder, frame_mask
from .._nets import FeedForward, join_heads, split_heads
from .._torch import F, Tensor, nn, torch

__all__ = ["Attention", "Embedder", "FeedForward", "MetricValuePredictor", "Predictor", "QPredictor", "Transformer"]


class Attention(nn.Module):
    """Attention to the frames (``"self"``), to the goal (``"cross"``), or to the frames from one query for each (``"frame"``)."""

    def __init__(
        self,
        dim: int,
        heads: int = 8,
        dim_head: int = 64,
        dropout: float = 0.0,
        num_patches: int = 1,
        num_frames: int = 1,
        att_type: str = "self",
        causal: bool = False,
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        inner = heads * dim_head
        self.heads: int = heads
        self.dropout: float = dropout
        self.num_patches: int = num_patches
        self.att_type: str = att_type
        self.norm: nn.Module = nn.LayerNorm(dim)
        if att_type == "cross":
            self.norm_c: nn.Module = nn.LayerNorm(dim)
        self.to_q: nn.Module = nn.Linear(dim, inner, bias=False)
        self.to_kv: nn.Module = nn.Linear(dim, 2 * inner, bias=False)
        plain = heads == 1 and inner == dim
        self.to_out: nn.Module = nn.Identity() if plain else nn.Sequential(nn.Linear(inner, dim), nn.Dropout(dropout))
        if att_type == "frame":
            self.frame_tokens: Tensor = nn.Parameter(torch.randn(1, num_frames, dim))
        if causal and att_type != "cross":
            queries = 1 if att_type == "frame" else num_patches
            self.register_buffer("causal_mask", frame_mask(num_frames, queries, num_patches))

    def forward(self, x: Tensor, goal: Tensor | None = None) -> Tensor:
        """``(B, T × P, W)``, and ``(B, P, W)`` of the goal, to the same, or to ``(B, T, W)`` of one query per frame."""
        x = self.norm(x)
        queries, keys = x, x
        if self.att_type == "cross":
            keys = self.norm_c(goal)
        elif self.att_type == "frame":
            queries = self.frame_tokens[:, : x.shape[1] // self.num_patches].expand(len(x), -1, -1)
        q = split_heads(self.to_q(queries), self.heads)
        k, v = (split_heads(part, self.heads) for part in self.to_kv(keys).chunk(2, dim=-1))
        mask: Any = getattr(self, "causal_mask", None)
        mask = None if mask is None else mask[:, :, : queries.shape[1], : keys.shape[1]]
        dropout = self.dropout if self.training else 0.0
        return self.to_out(join_heads(F.scaled_dot_product_attention(q, k, v, attn_mask=mask, dropout_p=dropout)))


class Transformer(nn.Module):
    """The blocks. ``kinds`` has what each looks at; one of ``"frame"`` has no residuals."""

    def __init__(
        self,
        dim: int,
        kinds: list[str],
        heads: int,
        dim_head: int,
        mlp_dim: int,
        dropout: float = 0.0,
        num_patches: int = 1,
        num_frames: int = 1,
        causal: bool = True,
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.kinds: list[str] = kinds
        self.num_patches: int = num_patches
        self.norm: nn.Module = nn.LayerNorm(dim)
        self.layers: nn.ModuleList = nn.ModuleList()
        for kind in kinds:
            attention = Attention(dim, heads, dim_head, dropout, num_patches, num_frames, kind, causal)
            self.layers.append(nn.ModuleList([attention, FeedForward(dim, mlp_dim, dropout)]))

    def forward(self, x: Tensor, goal: Tensor | None = None) -> Tensor:
        """``(B, T × P, W)`` frames and ``(B, P, W)`` goal to ``(B, T, W)``."""
        pairs: Any = self.layers
        for kind, (attention, feed_forward) in zip(self.kinds, pairs, strict=True):
            if kind == "frame":
                x = feed_forward(attention(x))
            else:
                x = attention(x, goal) + x
                x = feed_forward(x) + x
        tokens: Any = x
        return self.norm(tokens if "frame" in self.kinds else tokens.unflatten(1, (-1, self.num_patches)).mean(2))


def _kinds(depth: int, pool_type: str) -> list[str]:
    if pool_type not in ("attention", "mean"):
        raise ValueError(f"pool_type {pool_type!r} is not known here; give 'attention' or 'mean'")
    kinds = ["self" if index % 2 == 0 else "cross" for index in range(depth)]
    return [*kinds[:-1], "frame"] if pool_type == "attention" else kinds


class Predictor(nn.Module):
    """One vector of ``out_dim`` values per frame: an action, or a value. ``pool_type`` is ``"attention"`` or ``"mean"``."""

    def __init__(
        self,
        *,
        num_patches: int,
        num_frames: int,
        dim: int,
        depth: int,
        heads: int,
        mlp_dim: int,
        out_dim: int,
        dim_head: int = 64,
        dropout: float = 0.0,
        emb_dropout: float = 0.0,
        causal: bool = True,
        pool_type: str = "attention",
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.pos_embedding: Tensor = nn.Parameter(torch.randn(1, num_frames * num_patches, dim))
        self.pos_embedding_goal: Tensor = nn.Parameter(torch.randn(1, num_patches, dim))
        self.dropout: nn.Module = nn.Dropout(emb_dropout)
        kinds = _kinds(depth, pool_type)
        self.transformer: nn.Module = Transformer(dim, kinds, heads, dim_head, mlp_dim, dropout, num_patches, num_frames, causal)
        self.out_proj: nn.Module = nn.Linear(dim, out_dim)

    def _vectors(self, x: Tensor, goal: Tensor) -> Tensor:
        x = self.dropout(x + self.pos_embedding[:, : x.shape[1]])
        goal = self.dropout(goal + self.pos_embedding_goal[:, : goal.shape[1]])
        return self.transformer(x, goal)

    def forward(self, x: Tensor, goal: Tensor) -> Tensor:
        """``(B, T × P, W)`` frames and ``(B, P, W)`` goal to ``(B, T, out_dim)``."""
        return self.out_proj(self._vectors(x, goal))


class QPredictor(Predictor):
    """The value of actions, which join each frame's vector behind the transformer."""

    def __init__(self, *, dim: int, action_dim: int, q_hidden_dim: int = 256, **sizes: Any) -> None:
        super().__init__(dim=dim, out_dim=1, **sizes)
        del self.out_proj
        wide = q_hidden_dim
        layers = [nn.Linear(dim + action_dim, wide), nn.ReLU(), nn.Linear(wide, wide), nn.ReLU(), nn.Linear(wide, 1)]
        self.q_head: nn.Module = nn.Sequential(*layers)

    def forward(self, x: Tensor, actions: Tensor, goal: Tensor) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Frames, actions ``(B, T, A)`` and goal to ``(B, T, 1)``."""
        return self.q_head(torch.cat([self._vectors(x, goal), actions], dim=-1))


class MetricValuePredictor(nn.Module):
    """HILP's value (arXiv 2402.15567): minus the distance of embeddings of frames and goal, which go through the same blocks."""

    def __init__(
        self,
        *,
        num_patches: int,
        num_frames: int,
        dim: int,
        depth: int,
        heads: int,
        mlp_dim: int,
        embed_dim: int = 64,
        dim_head: int = 64,
        dropout: float = 0.0,
        emb_dropout: float = 0.0,
        causal: bool = True,
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.pos_embedding: Tensor = nn.Parameter(torch.randn(1, num_frames * num_patches, dim))
        # In files; goals take the first rows of the other.
        self.pos_embedding_goal: Tensor = nn.Parameter(torch.randn(1, num_patches, dim))
        self.dropout: nn.Module = nn.Dropout(emb_dropout)
        kinds = [*["self"] * (depth - 1), "frame"]
        self.transformer: nn.Module = Transformer(dim, kinds, heads, dim_head, mlp_dim, dropout, num_patches, num_frames, causal)
        self.embed_proj: nn.Module = nn.Linear(dim, embed_dim)

    def embed(self, x: Tensor) -> Tensor:
        """``(B, T × P, W)`` to ``(B, T, embed_dim)``."""
        return self.embed_proj(self.transformer(self.dropout(x + self.pos_embedding[:, : x.shape[1]])))

    def forward(self, x: Tensor, goal: Tensor) -> Tensor:
        """Frames and goal to ``(B, T, 1)``."""
        difference = self.embed(x) - self.embed(goal)
        return -difference.square().sum(-1, keepdim=True).clamp_min(1e-6).sqrt()
