"""What PreJEPA and the goal-conditioned policies share: encoders of frames to tokens, and of other columns, which join every token."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ._images import MEAN, STD, normalized
from ._nets import embedded
from ._torch import Tensor, nn, torch

__all__ = ["Embedder", "TokenModel", "frame_mask"]


def frame_mask(frames: int, queries: int, keys: int) -> Tensor:
    """Queries see the keys of their own and earlier frames: flags ``(1, 1, frames × queries, frames × keys)``."""
    seen = torch.ones(frames, frames, dtype=torch.bool).tril()
    return seen.repeat_interleave(queries, 0).repeat_interleave(keys, 1)[None, None]


class Embedder(nn.Module):
    """A convolution of size 1 over time: ``(B, T, in_chans)`` to ``(B, T, emb_dim)``."""

    def __init__(self, num_frames: int = 1, tubelet_size: int = 1, in_chans: int = 8, emb_dim: int = 10) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        if num_frames != 1 or tubelet_size != 1:
            raise ValueError(f"Embedder: num_frames={num_frames} and tubelet_size={tubelet_size}; only 1 and 1 are known here")
        self.emb_dim: int = emb_dim
        self.patch_embed: nn.Module = nn.Conv1d(in_chans, emb_dim, kernel_size=1)

    def forward(self, x: Tensor) -> Tensor:
        """Embeds every step by itself."""
        return embedded(x, self.patch_embed)


class TokenModel(nn.Module):
    """Sees frames as tokens, ``(B, T, P, W)``, to each of which the embeddings of other columns are appended."""

    # What holds the encoder of images, and what embeddings are called.
    _encoder_name: str = "encoder"

    def __init__(self, encoder: nn.Module, extra_encoders: Mapping[str, nn.Module] | nn.Module | None) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        setattr(self, self._encoder_name, encoder)
        known: Any = extra_encoders
        self.extra_encoders: Any = known if isinstance(known, nn.Module) or known is None else nn.ModuleDict(known)
        self._side: int | None = None
        self.image_mean: tuple[float, ...] = MEAN
        self.image_std: tuple[float, ...] = STD

    @property
    def image_size(self) -> int | None:
        """The side of the images whose patches are as many as the predictor takes; None: unknown, and bytes keep their size."""
        encoder: Any = getattr(self, self._encoder_name)
        sizes, patches = getattr(getattr(encoder, "backbone", encoder), "sizes", None), self._patches()
        if self._side is not None or sizes is None or patches is None:
            return self._side
        side = round(patches**0.5)
        return side * sizes.patch if side**2 == patches else None

    @image_size.setter
    def image_size(self, side: int | None) -> None:
        self._side = side

    def _patches(self) -> int | None:
        """Tokens of a frame, by what predicts from them; None: unknown."""
        return None

    def _extra_dims(self) -> dict[str, int]:
        """The dim of each appended embedding, in their order."""
        if self.extra_encoders is None:
            return {}
        return {key: module.patch_embed.weight.shape[0] for key, module in self.extra_encoders.items()}

    def _tokens(self, pixels: Any) -> Tensor:
        """``(B, T, 3, H, W)``, or bytes, to the tokens of patches ``(B, T, P, W)``."""
        encoder: Any = getattr(self, self._encoder_name)
        where = next(self.parameters())
        images = normalized(pixels, self.image_size, self.image_mean, self.image_std).to(where.device, where.dtype)
        found = encoder(images.flatten(0, 1), interpolate_pos_encoding=True).last_hidden_state[:, 1:]
        wanted = self._patches()
        if wanted is not None and found.shape[1] != wanted:
            shape = "x".join(map(str, images.shape[-2:]))
            fix = f"give images of {self.image_size}x{self.image_size}, or bytes, which are resized" if self.image_size else "give images of another size"
            raise ValueError(f"images of {shape} have {found.shape[1]} patches, and this model is of {wanted}; {fix}")
        return found.unflatten(0, images.shape[:2])

    def encode(
        self,
        info: dict[str, Any],
        pixels_key: str = "pixels",
        emb_keys: Sequence[str] | None = None,
        prefix: str | None = None,
        target: str = "emb",
    ) -> dict[str, Any]:
        """Adds ``pixels_<target>``, ``<key>_<target>`` of every key, and all of them joined, ``<target>``.

        Args:
            info: ``pixels``, ``(B, T, 3, H, W)`` or bytes, and columns ``(B, T, ...)``.
            pixels_key: Where the images are.
            emb_keys: Which columns; None: all that there are encoders of.
            prefix: Before the names of columns in ``info``.
            target: The name of what is added.
        """
        known = {} if self.extra_encoders is None else dict(self.extra_encoders.items())
        keys = list(known) if emb_keys is None else list(emb_keys)
        tokens = self._tokens(info[pixels_key])
        info[f"pixels_{target}"] = tokens
        parts = [tokens]
        for key in keys:
            column = f"{prefix or ''}{key}"
            if key not in known or column not in info:
                where = "this model has no encoder of it" if key not in known else f"the infos have {', '.join(info)}"
                raise ValueError(f"{type(self).__name__}.encode reads {column!r}, and {where}; leave it out of emb_keys or add it")
            embedded = known[key](info[column].to(tokens.device))
            info[f"{key}_{target}"] = embedded
            parts.append(embedded[:, :, None].expand(-1, -1, tokens.shape[2], -1))
        info[target] = torch.cat(parts, dim=-1)
        return info
