"""The network: convolutions that halve an image three times, and back, with a look at what each half had before (arXiv 1505.04597)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

from .._images import MEAN, STD, normalized
from .._torch import F, Tensor, nn, torch

__all__ = ["Canonical", "ImageTranslator"]

# Sides of images are multiples of this: three halvings.
STEP = 8
# Pixels along a side of what the last layer draws at each place.
_BLOCK = 2
# Maps of the image that is drawn: its colors, the same as they differ from its own mean, and where each pixel is.
_OWN = 8
# Added to the std of an image, so that one of a single color is finite.
_LEAST = 0.1


class Background(nn.Module):
    """What never changes in canonical images, and the std of all that does; found in the first batch of a training."""

    mean: Tensor
    std: Tensor

    def __init__(self, side: int) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.register_buffer("mean", torch.zeros(3, side, side))
        self.register_buffer("std", torch.ones(1))

    def forward(self, left: Tensor) -> Tensor:
        """``(N, 3, S, S)`` with the background added."""
        return left * self.std + self.mean

    def remove(self, images: Tensor) -> Tensor:
        """``(N, 3, S, S)`` without it."""
        return (images - self.mean) / self.std


class ImageTranslator(nn.Module):
    """From ``inputs`` maps to three colors; ``channels`` at a half, a quarter and an eighth of the image."""

    def __init__(self, inputs: int, channels: Sequence[int]) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        half, quarter, eighth = channels
        made: Any = nn.Conv2d
        # A module of torch has a method `half`.
        self.to_half: nn.Module = made(inputs, half, 5, stride=2, padding=2)
        self.quarter: nn.Module = made(half, quarter, 3, stride=2, padding=1)
        self.quarter_again: nn.Module = made(quarter, quarter, 3, padding=1)
        self.eighth: nn.Module = made(quarter, eighth, 3, stride=2, padding=1)
        self.eighth_again: nn.Module = made(eighth, eighth, 3, padding=1)
        self.up_to_quarter: nn.Module = made(eighth + quarter, quarter, 3, padding=1)
        self.up_to_half: nn.Module = made(quarter + half, half, 3, padding=1)
        self.blocks: nn.Module = nn.Linear(half, 3 * _BLOCK * _BLOCK)

    def forward(self, seen: Tensor) -> Tensor:
        """``(N, inputs, H, W)`` to ``(N, 3, H, W)``; sides are multiples of 8."""
        half = F.relu(self.to_half(seen))
        quarter = F.relu(self.quarter_again(F.relu(self.quarter(half))))
        eighth = F.relu(self.eighth_again(F.relu(self.eighth(quarter))))
        quarter = F.relu(self.up_to_quarter(torch.cat([_doubled(eighth), quarter], dim=1)))
        half = F.relu(self.up_to_half(torch.cat([_doubled(quarter), half], dim=1)))
        # Each place draws a block of pixels: rows, columns, colors.
        blocks: Any = self.blocks(half.movedim(1, -1)).unflatten(-1, (_BLOCK, _BLOCK, 3))
        count, rows, columns = blocks.shape[:3]
        return blocks.permute(0, 5, 1, 3, 2, 4).reshape(count, 3, rows * _BLOCK, columns * _BLOCK)


def _doubled(maps: Any) -> Tensor:
    """Each place as two by two."""
    return maps.repeat_interleave(2, dim=-2).repeat_interleave(2, dim=-1)


class Canonical(nn.Module):
    """Draws images of any look in the canonical one, each beside a second frame where it was trained with two.

    One image cannot say which of two equal shapes is the block and which marks the goal; two frames of an episode can, as marks never move. Draw an
    observation beside the goal, and the goal beside the observation.

    Args:
        image: S, the side of images: a multiple of 8.
        channels: Of the network, at a half, a quarter and an eighth of the image.
        frames: Images that it sees to draw one: 1, or 2.

    Example:
        >>> drawing = load_canonical("runs/canonical")  # doctest: +SKIP
        >>> pixels = drawing.draw(infos["pixels"], infos["goal"])  # doctest: +SKIP
    """

    def __init__(self, image: int = 64, channels: Sequence[int] = (24, 40, 56), frames: int = 2) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        if image < STEP or image % STEP:
            raise ValueError(f"image is {image}; it must be a multiple of {STEP}")
        if frames not in (1, 2):
            raise ValueError(f"frames is {frames}; it draws from 1 frame or 2")
        if len(channels) != 3 or min(channels) < 1:
            raise ValueError(f"channels are {list(channels)}; give three numbers from 1 on: at a half, a quarter and an eighth of the image")
        self.image: int = image
        self.frames: int = frames
        self.background: nn.Module = Background(image)
        self.network: nn.Module = ImageTranslator(_OWN + 3 * (frames - 1), channels)

    def forward(self, images: Tensor, others: Tensor | None = None) -> Tensor:
        """Images standardized as ImageNet's, ``(N, 3, S, S)``, and those beside them, to what they are in the canonical look; gradients flow.

        Raises:
            ValueError: ``others`` is missing where the network sees two frames, or has another shape.
        """
        return cast("Any", self.background)(self._drawn(images, self._beside(images, others)))

    def _beside(self, images: Any, others: Any) -> Any:
        if self.frames == 1:
            return images
        if others is None:
            raise ValueError("the network sees two frames; give the second: the goal beside an observation, the observation beside the goal")
        if others.shape != images.shape:
            raise ValueError(f"{list(images.shape)} images beside {list(others.shape)} others; each is drawn beside one: give both one shape")
        return others

    def _drawn(self, images: Any, others: Any) -> Tensor:
        count, _, rows, columns = images.shape
        if rows % STEP or columns % STEP:
            raise ValueError(f"images [N, 3, S, S] = {list(images.shape)}; sides are multiples of {STEP}")
        mean = images.mean((-2, -1), keepdim=True)
        apart = images - mean
        std = apart.square().mean((-2, -1), keepdim=True).sqrt() + _LEAST
        seen = [images, apart / std, _coordinates(rows, columns, images).expand(count, -1, -1, -1)]
        if self.frames == 2:
            seen.append((others - mean) / std)
        return self.network(torch.cat(seen, dim=1))

    def draw(self, images: Any, others: Any = None) -> Tensor:
        """Images of bytes ``(..., H, W, 3)`` or ``(..., 3, H, W)``, and those beside them, as bytes ``(..., S, S, 3)`` in the canonical look.

        They are resized to S × S. ``others`` broadcast: one goal ``(B, 1, ...)`` beside T observations ``(B, T, ...)``.

        Raises:
            TypeError: Images are no bytes.
        """
        where: Any = next(cast("Any", self).parameters())

        def standardized(given: Any) -> Any:
            values = torch.as_tensor(given)
            if values.dtype != torch.uint8:
                raise TypeError(f"images are {values.dtype}; draw takes bytes (uint8), and forward standardized floats")
            return cast("Any", normalized(values, self.image)).to(where.device)

        with torch.no_grad():
            own = standardized(images)
            beside = None if others is None else standardized(others).expand(own.shape)
            leading = own.shape[:-3]
            flat = own.reshape(-1, *own.shape[-3:])
            drawn: Any = self(flat, None if beside is None else beside.reshape(flat.shape))
            center, scale = (drawn.new_tensor(values).reshape(3, 1, 1) for values in (MEAN, STD))
            # Half a level is rounded away from zero, as in Rust.
            levels = ((drawn * scale + center) * 255 + 0.5).floor().clamp(0, 255).nan_to_num(0)
            return levels.to(torch.uint8).movedim(1, -1).reshape(*leading, self.image, self.image, 3)


def _coordinates(rows: int, columns: int, like: Any) -> Any:
    """x and y of each pixel, from -1 to 1: ``(1, 2, rows, columns)``."""

    def places(count: int) -> Any:
        return (2 * torch.arange(count, device=like.device, dtype=like.dtype) + 1) / count - 1

    return torch.stack([places(columns).expand(rows, columns), places(rows)[:, None].expand(rows, columns)])[None]
