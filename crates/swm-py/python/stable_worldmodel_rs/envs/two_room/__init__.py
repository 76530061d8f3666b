"""The expert of TwoRoom, by the reference's name; it acts in Rust."""

from __future__ import annotations

from ...world.policies import NativePolicy

__all__ = ["ExpertPolicy"]


class ExpertPolicy(NativePolicy):
    """Walks to the target, through a door if need be. The policy ``expert`` of the command.

    Args:
        action_noise: Standard deviation of the noise on each component.
        action_repeat_prob: How likely the last action is repeated.
        seed: Seed of its own noise; None: noise comes from the episodes' seeds.
    """

    def __init__(self, action_noise: float = 0.0, action_repeat_prob: float = 0.0, *, seed: int | None = None) -> None:
        super().__init__("expert", seed=seed or 0, noise=action_noise, action_repeat_prob=action_repeat_prob)
