"""The experts of OGBench's Cube and Scene, by the reference's name; they act in Rust."""

from __future__ import annotations

from typing import Literal

from ...world.policies import NativePolicy

__all__ = ["ExpertPolicy"]

_NAMES = {"markov_oracle": "markov-expert", "plan_oracle": "expert"}


class ExpertPolicy(NativePolicy):
    """Picks up what the task names and places it. The policies ``markov-expert`` and ``expert`` of the command.

    Args:
        policy_type: ``"markov_oracle"`` (decides by the present observation) or ``"plan_oracle"`` (follows a plan).
        action_noise: Standard deviation of the noise.
        p_random_action: How likely an action is random.
        noise_smoothing, min_norm: Of the noise on plans, and of small motions.
        seed: Seed of its own noise; None: noise comes from the episodes' seeds.
    """

    def __init__(
        self,
        policy_type: Literal["markov_oracle", "plan_oracle"] = "markov_oracle",
        action_noise: float = 0.1,
        p_random_action: float = 0.0,
        noise_smoothing: float = 0.5,
        min_norm: float = 0.4,
        *,
        seed: int | None = None,
    ) -> None:
        if policy_type not in _NAMES:
            raise ValueError(f"policy_type: {policy_type!r} is not one of {sorted(_NAMES)}")
        super().__init__(
            _NAMES[policy_type],
            seed=seed or 0,
            noise=action_noise,
            p_random_action=p_random_action,
            noise_smoothing=noise_smoothing,
            min_norm=min_norm,
        )
