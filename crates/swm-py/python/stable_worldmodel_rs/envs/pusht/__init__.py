"""Policies for PushT, by the reference's names; they act in Rust."""

from __future__ import annotations

from typing import Any

from ...world.policies import NativePolicy

__all__ = ["ExpertPolicy", "WeakPolicy"]


class WeakPolicy(NativePolicy):
    """Random pushes near the block: rich in contacts, never successful. The policy ``weak`` of the command.

    Args:
        dist_constraint: Half the side of the square around the block in which targets are sampled, in pixels.
        seed: Seed of its own noise; None: noise comes from the episodes' seeds.

    Example:
        >>> world = World("swm/PushT-v1", num_envs=8, image_shape=(64, 64))
        >>> world.set_policy(WeakPolicy(dist_constraint=100))
        >>> world.collect("weak.h5", episodes=100, seed=0)
    """

    def __init__(self, dist_constraint: float = 100, seed: int | None = None) -> None:
        if dist_constraint <= 0:
            raise ValueError(f"dist_constraint must be above 0, found {dist_constraint}")
        super().__init__("weak", seed=seed or 0, dist_constraint=dist_constraint)


class ExpertPolicy(NativePolicy):
    """Searches over pushes on the true simulator. The policy ``expert`` of the command.

    Args:
        seed: Seed of its own noise; None: noise comes from the episodes' seeds.
        **settings: As ``swm-rs envs swm/PushT-v1`` lists them: ``std``, ``temperature``, …
    """

    def __init__(self, seed: int | None = None, **settings: Any) -> None:
        super().__init__("expert", seed=seed or 0, **settings)
