"""What TD-MPC2 learns: consistent latents, rewards and values as distributions over bins, and a policy that the values rate."""

from __future__ import annotations

import random
from typing import Any, cast

from .._torch import F, Tensor, torch
from .module import gaussian_logprob, log_std, setting, squash, two_hot, two_hot_inv

__all__ = ["tdmpc2_forward"]


def tdmpc2_forward(self: Any, batch: dict[str, Any], stage: str, cfg: Any) -> dict[str, Any]:
    """The loss of a batch of clips, as the step of a training: ``batch["loss"]`` and what ``self.log_dict`` is given.

    With ``stage="train"``, the target values follow the values by ``cfg.wm.tau``.

    Args:
        self: Has the model as ``model``, and ``log_dict``, as a Lightning module has.
        batch: The columns of ``cfg.wm.encoding`` ``(B, T, ...)``, ``action`` ``(B, T, A)`` and ``reward`` ``(B, T)``, with T of ``cfg.wm.horizon`` + 1.
        stage: A name for the logs.
        cfg: The config of the model, with ``wm.horizon``, ``wm.rho``, and the coefficients of the losses.
    """
    model: Any = self.model
    horizon, rho, tau = int(setting(cfg, "wm.horizon")), float(setting(cfg, "wm.rho")), float(setting(cfg, "wm.tau"))
    columns = list(cast("dict[str, Any]", setting(cfg, "wm.encoding", {})))
    latents = model.encode({key: batch[key] for key in columns})
    sums: dict[str, Any] = dict.fromkeys(("consist", "reward", "value", "policy"), 0.0)
    z = latents[:, 0]
    for step in range(horizon):
        action, reward, following = batch["action"][:, step], batch["reward"][:, step], latents[:, step + 1].detach()
        predicted, logits = model(z, action)
        target = two_hot(_target(model, following, reward, cfg), cfg)
        both = torch.cat([z, action], dim=-1)
        parts = {
            "consist": F.mse_loss(predicted, following),
            "reward": _cross_entropy(two_hot(reward, cfg), logits),
            "value": sum(_cross_entropy(target, q(both)) for q in model.qs) / len(model.qs),
            "policy": _policy_loss(model, z.detach(), cfg, step == 0),
        }
        for name, value in parts.items():
            sums[name] = sums[name] + value * rho**step
        z = predicted
    means = {name: value / horizon for name, value in sums.items()}
    weights = {name: float(setting(cfg, f"wm.{key}")) for name, key in (("consist", "consistency_coef"), ("reward", "reward_coef"), ("value", "value_coef"))}
    loss = sum(weights.get(name, 1.0) * value for name, value in means.items())
    logged = {f"{stage}/loss": loss} | {f"{stage}/{name}": value for name, value in means.items()}
    self.log_dict(logged, on_step=True, sync_dist=False, prog_bar=True)
    if stage == "train":
        with torch.no_grad():
            for mine, follower in zip(model.qs.parameters(), model.target_qs.parameters(), strict=True):
                follower.lerp_(mine, tau)
    batch["loss"] = loss
    return batch


def _cross_entropy(target: Tensor, logits: Tensor) -> Tensor:
    return -(target * F.log_softmax(logits, dim=-1)).sum(-1).mean()


def _pair(count: int) -> list[int]:
    """Two of the values; both times the same one where there is one."""
    return random.sample(range(count), 2) if count > 1 else [0, 0]


def _target(model: Any, z: Tensor, reward: Tensor, cfg: Any) -> Tensor:
    """Rewards and the smaller of two target values of what the policy does next, ``(B, 1)``."""
    with torch.no_grad():
        mean, spread = model.pi(z).chunk(2, dim=-1)
        action = torch.tanh(mean + torch.randn_like(mean) * log_std(spread).exp())
        both = torch.cat([z, action], dim=-1)
        first, second = (two_hot_inv(model.target_qs[one](both), cfg) for one in _pair(len(model.target_qs)))
        flat: Any = reward
        return flat.reshape(-1, 1) + float(setting(cfg, "wm.discount", 0.99)) * torch.minimum(first, second)


def _policy_loss(model: Any, z: Tensor, cfg: Any, is_first: bool) -> Tensor:
    """Minus the value, in units of its range, and the entropy of what the policy does at ``z``."""
    mean, spread = model.pi(z).chunk(2, dim=-1)
    noise, scale = torch.randn_like(mean), log_std(spread)
    _, action, density = squash(mean, mean + noise * scale.exp(), gaussian_logprob(noise, scale))
    both = torch.cat([z, action], dim=-1)
    model.qs.requires_grad_(False)
    try:
        values = [two_hot_inv(q(both), cfg) for q in model.qs]
    finally:
        model.qs.requires_grad_(True)
    first, second = _pair(len(values))
    value = (values[first] + values[second]) / 2
    if is_first:
        model.scale.update(value)
    entropy = -density * mean.shape[-1]
    return -(float(setting(cfg, "wm.entropy_coef", 1e-4)) * entropy + model.scale(value)).mean()
