"""The parts of LeWM, under the reference's names."""

from __future__ import annotations

from .._nets import MLP, Attention, ConditionalBlock, Embedder, FeedForward, Predictor, Transformer

__all__ = ["MLP", "Attention", "ConditionalBlock", "Embedder", "FeedForward", "Predictor", "Transformer"]
