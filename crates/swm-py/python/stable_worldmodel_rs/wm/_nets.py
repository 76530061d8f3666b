"""The parts of LeWM and PLDM: a causal transformer that actions steer, embedders of actions, projectors.

Attributes have the names that the reference's files of weights have. Architectures: LeWM, arXiv 2603.19312; adaptive layer norms
that begin at zero, arXiv 2212.09748.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ._torch import F, Tensor, nn, torch

__all__ = ["MLP", "Attention", "ConditionalBlock", "Embedder", "FeedForward", "Predictor", "Transformer", "embedded", "join_heads", "split_heads"]


def split_heads(tokens: Tensor, heads: int) -> Tensor:
    """``(B, N, heads × E)`` to ``(B, heads, N, E)``."""
    flat: Any = tokens
    return flat.unflatten(-1, (heads, -1)).transpose(1, 2)


def join_heads(tokens: Tensor) -> Tensor:
    """``(B, heads, N, E)`` to ``(B, N, heads × E)``."""
    return tokens.transpose(1, 2).flatten(2)


def _projection(inner: int, dim: int, heads: int, dropout: float) -> nn.Module:
    """What joins the heads; nothing where one head has the dim of the tokens."""
    if heads == 1 and inner == dim:
        return nn.Identity()
    return nn.Sequential(nn.Linear(inner, dim), nn.Dropout(dropout))


class Attention(nn.Module):
    """Causal self-attention that normalizes its input: ``(B, N, dim)`` to the same."""

    def __init__(self, dim: int, heads: int = 8, dim_head: int = 64, dropout: float = 0.0) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        inner = heads * dim_head
        self.heads: int = heads
        self.dropout: float = dropout
        self.norm: nn.Module = nn.LayerNorm(dim)
        self.to_qkv: nn.Module = nn.Linear(dim, 3 * inner, bias=False)
        self.to_out: nn.Module = _projection(inner, dim, heads, dropout)

    def forward(self, x: Tensor) -> Tensor:
        """Attends to the tokens up to each one's own."""
        q, k, v = (split_heads(part, self.heads) for part in self.to_qkv(self.norm(x)).chunk(3, dim=-1))
        dropout = self.dropout if self.training else 0.0
        return self.to_out(join_heads(F.scaled_dot_product_attention(q, k, v, dropout_p=dropout, is_causal=True)))


class FeedForward(nn.Module):
    """Two linear layers with a GELU between them, behind a layer norm."""

    def __init__(self, dim: int, hidden_dim: int, dropout: float = 0.0) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        parts = [nn.LayerNorm(dim), nn.Linear(dim, hidden_dim), nn.GELU(), nn.Dropout(dropout)]
        self.net: nn.Module = nn.Sequential(*parts, nn.Linear(hidden_dim, dim), nn.Dropout(dropout))

    def forward(self, x: Tensor) -> Tensor:
        """``(..., dim)`` to the same."""
        return self.net(x)


class ConditionalBlock(nn.Module):
    """Attention and MLP whose inputs are shifted and scaled, and whose outputs are gated, as a condition says."""

    def __init__(self, dim: int, heads: int, dim_head: int, mlp_dim: int, dropout: float = 0.0) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.attn: nn.Module = Attention(dim, heads, dim_head, dropout)
        self.mlp: nn.Module = FeedForward(dim, mlp_dim, dropout)
        self.norm1: nn.Module = nn.LayerNorm(dim, eps=1e-6, elementwise_affine=False)
        self.norm2: nn.Module = nn.LayerNorm(dim, eps=1e-6, elementwise_affine=False)
        last: Any = nn.Linear(dim, 6 * dim)
        nn.init.zeros_(last.weight)  # At first, a block passes its input on.
        nn.init.zeros_(last.bias)
        self.adaLN_modulation: nn.Module = nn.Sequential(nn.SiLU(), last)

    def forward(self, x: Tensor, c: Tensor) -> Tensor:
        """States and conditions, ``(B, T, dim)`` each."""
        shift_a, scale_a, gate_a, shift_m, scale_m, gate_m = self.adaLN_modulation(c).chunk(6, dim=-1)
        x = x + gate_a * self.attn(self.norm1(x) * (1 + scale_a) + shift_a)
        return x + gate_m * self.mlp(self.norm2(x) * (1 + scale_m) + shift_m)


def _between(inputs: int, outputs: int) -> nn.Module:
    return nn.Identity() if inputs == outputs else nn.Linear(inputs, outputs)


class Transformer(nn.Module):
    """Conditional blocks between projections of what goes in and comes out, where their dims differ."""

    def __init__(
        self,
        input_dim: int,
        hidden_dim: int,
        output_dim: int,
        depth: int,
        heads: int,
        dim_head: int,
        mlp_dim: int,
        dropout: float = 0.0,
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.norm: nn.Module = nn.LayerNorm(hidden_dim)
        blocks = [ConditionalBlock(hidden_dim, heads, dim_head, mlp_dim, dropout) for _ in range(depth)]
        self.layers: nn.ModuleList = nn.ModuleList(blocks)
        self.input_proj: nn.Module = _between(input_dim, hidden_dim)
        self.cond_proj: nn.Module = _between(input_dim, hidden_dim)
        self.output_proj: nn.Module = _between(hidden_dim, output_dim)

    def forward(self, x: Tensor, c: Tensor) -> Tensor:
        """States and conditions, ``(B, T, input_dim)`` each, to ``(B, T, output_dim)``."""
        x, c = self.input_proj(x), self.cond_proj(c)
        for block in self.layers:
            x = block(x, c)
        return self.output_proj(self.norm(x))


class Predictor(nn.Module):
    """Predicts each next state from those before it and the actions taken.

    Args:
        num_frames: The most states that it sees.
    """

    def __init__(
        self,
        *,
        num_frames: int,
        depth: int,
        heads: int,
        mlp_dim: int,
        input_dim: int,
        hidden_dim: int,
        output_dim: int | None = None,
        dim_head: int = 64,
        dropout: float = 0.0,
        emb_dropout: float = 0.0,
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.pos_embedding: Tensor = nn.Parameter(torch.randn(1, num_frames, input_dim))
        self.dropout: nn.Module = nn.Dropout(emb_dropout)
        self.transformer: nn.Module = Transformer(
            input_dim, hidden_dim, output_dim or input_dim, depth, heads, dim_head, mlp_dim, dropout
        )

    def forward(self, x: Tensor, c: Tensor) -> Tensor:
        """States and embedded actions ``(B, T, input_dim)`` to the states after each, ``(B, T, output_dim)``."""
        frames, most = x.shape[1], self.pos_embedding.shape[1]
        if frames > most:
            raise ValueError(f"the predictor sees {most} states at most (num_frames), and was given {frames}; give it the last ones")
        return self.transformer(self.dropout(x + self.pos_embedding[:, :frames]), c)


def embedded(x: Tensor, convolution: Any) -> Tensor:
    """Rows ``(B, T, in)`` through a convolution of size 1 over time.

    Raises:
        ValueError: they have another width than the model takes.
    """
    wanted: int = convolution.in_channels
    if x.shape[-1] != wanted:
        raise ValueError(
            f"rows of {x.shape[-1]} values were given, and the model takes {wanted}: actions are those of a block (action_block × the values "
            "of an action of its environment), other columns those that it was trained on"
        )
    return convolution(x.float().transpose(1, 2)).transpose(1, 2)


class Embedder(nn.Module):
    """What the world models see of a block of actions: ``(B, T, input_dim)`` to ``(B, T, emb_dim)``."""

    def __init__(self, input_dim: int = 10, smoothed_dim: int = 10, emb_dim: int = 10, mlp_scale: int = 4) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.patch_embed: nn.Module = nn.Conv1d(input_dim, smoothed_dim, kernel_size=1)
        wide = mlp_scale * emb_dim
        self.embed: nn.Module = nn.Sequential(nn.Linear(smoothed_dim, wide), nn.SiLU(), nn.Linear(wide, emb_dim))

    def forward(self, x: Tensor) -> Tensor:
        """Embeds every block by itself."""
        return self.embed(embedded(x, self.patch_embed))


class MLP(nn.Module):
    """Linear, norm, activation, linear: ``(N, input_dim)`` to ``(N, output_dim)``."""

    def __init__(
        self,
        input_dim: int,
        hidden_dim: int,
        output_dim: int | None = None,
        norm_fn: Callable[[int], nn.Module] | None = nn.LayerNorm,
        act_fn: Callable[[], nn.Module] = nn.GELU,
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        norm: nn.Module = nn.Identity() if norm_fn is None else norm_fn(hidden_dim)
        parts = [nn.Linear(input_dim, hidden_dim), norm, act_fn(), nn.Linear(hidden_dim, output_dim or input_dim)]
        self.net: nn.Module = nn.Sequential(*parts)

    def forward(self, x: Tensor) -> Tensor:
        """Batch norm takes all rows for one batch."""
        return self.net(x)
