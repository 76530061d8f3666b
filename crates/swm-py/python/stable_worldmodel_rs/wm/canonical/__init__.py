"""Images of any look drawn in one canonical look of the same state: what goes in front of an encoder. Trained by ``swm train canonical``."""

from __future__ import annotations

from .canonical import Canonical, ImageTranslator
from .run import load_canonical

__all__ = ["Canonical", "ImageTranslator", "load_canonical"]
