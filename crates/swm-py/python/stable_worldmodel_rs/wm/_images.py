"""Images as the models are given them: floats, channels first, normalized as ImageNet's."""

from __future__ import annotations

from typing import Any

from ._torch import F, Tensor, torch

__all__ = ["HALF", "MEAN", "STD", "normalized"]

MEAN = (0.485, 0.456, 0.406)
STD = (0.229, 0.224, 0.225)
HALF = (0.5, 0.5, 0.5)
"""Mean and std of images from -1 to 1, as the authors of DINO-WM give them to their model."""


def normalized(pixels: Any, side: int | None = None, mean: tuple[float, ...] = MEAN, std: tuple[float, ...] = STD) -> Tensor:
    """Images of bytes, ``(..., H, W, 3)`` or ``(..., 3, H, W)``, as floats ``(..., 3, side, side)``; floats are returned as they are.

    ``side=None`` keeps their size. Resizing is bilinear and antialiased, behind the normalization.
    """
    images = torch.as_tensor(pixels)
    if images.is_floating_point():
        return images
    if images.ndim < 3 or 3 not in (images.shape[-1], images.shape[-3]):
        raise ValueError(f"images of shape {tuple(images.shape)}; give (..., H, W, 3) or (..., 3, H, W)")
    if images.shape[-1] == 3:
        images = images.movedim(-1, -3)
    images = images.float() / 255
    center, scale = (images.new_tensor(values).reshape(3, 1, 1) for values in (mean, std))
    images = (images - center) / scale
    if side is not None and images.shape[-2:] != (side, side):
        shape = images.shape[:-3]
        flat = F.interpolate(images.reshape(-1, *images.shape[-3:]), size=(side, side), mode="bilinear", antialias=True)
        images = flat.reshape(*shape, *flat.shape[-3:])
    return images
