"""The model of TD-MPC2: latents of observations, what follows an action, its reward, values, and actions of its own."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any, cast

from .._images import normalized
from .._torch import Tensor, nn, torch
from .module import NormedLinear, RunningScale, SimNorm, log_std, mlp, setting, two_hot_inv

__all__ = ["TDMPC2"]

# Of the convolutions: kernel and stride of each, and the channels of all.
_CONVOLUTIONS = ((7, 2), (5, 2), (3, 2), (3, 1))
_CHANNELS = 32
_PIXELS = "pixels"
_DROPOUT = 0.01


class TDMPC2(nn.Module):
    """The networks of TD-MPC2, and planning with them.

    Actions are from -1 to 1, as the policy's are; rewards and values within ``symexp`` of ``vmin`` and ``vmax``.

    Args:
        cfg: A dict, or OmegaConf's node: ``wm`` (``encoding``: latent dims by column, ``enc_dim``, ``mlp_dim``, ``num_q``, ``num_bins``, ``vmin``, ``vmax``,
            ``tau``, ``simnorm_dim``, ``discount``, ``uncertainty_penalty``), ``action_dim``, ``extra_dims`` (dims of the columns that are no images), and
            ``image_size`` for images.
        extra_encoders: In the place of the MLPs of the columns that are no images, by column; each gives as many values as ``encoding`` has.

    Raises:
        ValueError: a setting is missing or impossible, by its path.
    """

    def __init__(self, cfg: Any, extra_encoders: nn.Module | None = None) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.cfg: Any = cfg
        encoding = self._encoding()
        self.use_pixels: bool = _PIXELS in encoding
        self.latent_dim: int = sum(encoding.values())
        if self.latent_dim == 0:
            raise ValueError("cfg.wm.encoding names no column; give the dims of their latents, such as {'state': 128}")
        self.action_dim: int = _whole(cfg, "action_dim")
        width, simplex = _whole(cfg, "wm.mlp_dim"), int(setting(cfg, "wm.simnorm_dim", 8))
        if self.latent_dim % simplex:
            raise ValueError(f"cfg.wm.encoding: latents of {self.latent_dim} values are no multiple of simnorm_dim, {simplex}")
        self.scale: nn.Module = RunningScale(float(setting(cfg, "wm.tau")))
        if self.use_pixels:
            self.image_size: int = _whole(cfg, "image_size")
            self.cnn: nn.Module = _convolutions()
            self.pixel_encoder: nn.Module = nn.Linear(_convolved(self.image_size), encoding[_PIXELS])
        columns: dict[str, int] = {key: dim for key, dim in encoding.items() if key != _PIXELS}
        self.extra_encoders: nn.Module = nn.ModuleDict(self._encoders(columns)) if extra_encoders is None else extra_encoders
        self.sim_norm: nn.Module = SimNorm(cfg)
        both, bins = self.latent_dim + self.action_dim, _whole(cfg, "wm.num_bins")
        self.dynamics: nn.Module = mlp(both, width, self.latent_dim, act=SimNorm(cfg))
        self.reward: nn.Module = mlp(both, width, bins)
        self.pi: nn.Module = mlp(self.latent_dim, width, 2 * self.action_dim)
        qs: Any = nn.ModuleList([mlp(both, width, bins, dropout=_DROPOUT) for _ in range(_whole(cfg, "wm.num_q"))])
        self.qs: nn.Module = qs
        self.target_qs: nn.Module = deepcopy(qs)
        cast("Any", self.target_qs).requires_grad_(False)
        self._begin()

    def _encoding(self) -> dict[str, int]:
        found: Any = setting(self.cfg, "wm.encoding", {})
        if not hasattr(found, "items"):
            raise ValueError(f"cfg.wm.encoding is {found!r}; give the dims of latents by column, such as {{'state': 128}}")
        return {str(key): _positive(dim, f"wm.encoding.{key}") for key, dim in found.items()}

    def _encoders(self, columns: Mapping[str, int]) -> dict[str, nn.Module]:
        hidden = _whole(self.cfg, "wm.enc_dim") if columns else 0
        return {
            key: nn.Sequential(NormedLinear(_whole(self.cfg, f"extra_dims.{key}"), hidden), nn.Linear(hidden, dim), nn.LayerNorm(dim))
            for key, dim in columns.items()
        }

    def _begin(self) -> None:
        """The weights that training begins with; of rewards and values, all bins are equal."""
        for part in cast("Any", self).modules():
            if isinstance(part, nn.Linear):
                linear: Any = part
                nn.init.trunc_normal_(linear.weight, std=0.02)
                if linear.bias is not None:
                    nn.init.zeros_(linear.bias)
        for head in (self.reward, *cast("Any", self.qs), *cast("Any", self.target_qs)):
            nn.init.zeros_(cast("Any", head)[-1].weight)

    # Observations.

    def encode(self, obs_dict: Mapping[str, Any]) -> Tensor:
        """Latents ``(..., Z)`` of the columns of ``cfg.wm.encoding``, ``(..., D)`` each.

        Images of bytes, ``(..., H, W, 3)`` or ``(..., 3, H, W)``, are normalized as ImageNet's and resized to ``image_size``; floats are taken
        as they are.

        Raises:
            ValueError: a column is missing, or of another dim.
        """
        first: Any = next(cast("Any", self).parameters())
        found: list[Any] = []
        if self.use_pixels:
            images: Any = normalized(self._column(obs_dict, _PIXELS), self.image_size)
            images = images.movedim(-1, -3) if images.shape[-1] == 3 and images.shape[-3] != 3 else images
            if tuple(images.shape[-3:]) != (3, self.image_size, self.image_size):
                raise ValueError(f"pixels: images {list(images.shape[-3:])}; the model takes [3, {self.image_size}, {self.image_size}], cfg.image_size")
            flat = images.to(device=first.device, dtype=first.dtype).reshape(-1, *images.shape[-3:])
            latents: Any = self.pixel_encoder(self.cnn(flat))
            found.append(latents.reshape(*images.shape[:-3], -1))
        for key, encoder in cast("Any", self.extra_encoders).items():
            values = torch.as_tensor(self._column(obs_dict, key)).to(device=first.device, dtype=first.dtype)
            wanted = int(setting(self.cfg, f"extra_dims.{key}", values.shape[-1]))
            if values.shape[-1] != wanted:
                raise ValueError(f"{key}: {list(values.shape)}, rows of {values.shape[-1]} values; the model takes {wanted}, cfg.extra_dims.{key}")
            found.append(encoder(values))
        return self.sim_norm(torch.cat(found, dim=-1))

    def _column(self, columns: Mapping[str, Any], key: str) -> Any:
        if key not in columns:
            raise ValueError(f"the model encodes {', '.join(self._encoding())}, and {key!r} is not there; there are {', '.join(columns)}")
        return columns[key]

    def _latent(self, info: Mapping[str, Any], leading: int) -> Tensor:
        """Latents of the present: infos have ``leading`` axes, and one of time if it is theirs."""
        seen: dict[str, Any] = {}
        for key in self._encoding():
            value = torch.as_tensor(self._column(info, key))
            if value.ndim > leading + (3 if key == _PIXELS else 1):
                value = value.select(leading, -1)  # Of several frames, the last.
            seen[key] = value
        if leading == 2 and all(value.shape[1] > 1 and value.stride(1) == 0 for value in seen.values()):
            seen = {key: value[:, :1] for key, value in seen.items()}  # Expanded over candidates: one for all.
        return self.encode(seen)

    # The model.

    def forward(self, z: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """Latents ``(B, Z)`` and actions ``(B, A)`` to the next latents ``(B, Z)`` and logits of the reward ``(B, num_bins)``.

        Raises:
            ValueError: actions have another dim.
        """
        both = self._joined(z, action)
        return self.dynamics(both), self.reward(both)

    def _joined(self, z: Tensor, action: Tensor) -> Tensor:
        if action.shape[-1] != self.action_dim:
            raise ValueError(
                f"actions {list(action.shape)}, of {action.shape[-1]} values each; the model takes {self.action_dim}, cfg.action_dim"
            )
        return torch.cat([z, action], dim=-1)

    def rollout(self, z: Tensor, horizon: int, num_trajs: int = 1) -> Tensor:
        """The policy's own actions ``(B, horizon, A)`` from latents ``(B, Z)``: the mean of ``num_trajs`` samples, by the generator of torch."""
        total: Any = 0.0
        for _ in range(num_trajs):
            now, actions = z, list[Any]()
            for _ in range(horizon):
                mean, spread = self.pi(now).chunk(2, dim=-1)
                action = torch.tanh(mean + log_std(spread).exp() * torch.randn_like(mean))
                actions.append(action)
                now = self.dynamics(self._joined(now, action))
            total = total + torch.stack(actions, dim=1)
        return total / num_trajs

    def get_action(self, info_dict: Mapping[str, Any], horizon: int = 1, prefix_actions: Tensor | None = None) -> Tensor:
        """The policy's own actions ``(B, horizon, A)``, after ``prefix_actions`` ``(B, t, A)``: samples, with ``cfg.num_pi_trajs`` their mean.

        Raises:
            ValueError: actions have another dim, or a column is missing.
        """
        z = self._latent(info_dict, 1)
        if prefix_actions is not None:
            for action in cast("Any", prefix_actions).to(device=z.device, dtype=z.dtype).unbind(1):
                z = self.dynamics(self._joined(z, action))
        return self.rollout(z, horizon, int(setting(self.cfg, "num_pi_trajs", 1)))

    def get_cost(self, info_dict: Mapping[str, Any], action_candidates: Tensor) -> Tensor:
        """Minus the discounted rewards of candidates ``(B, S, H, A)`` and the value of where they end, ``(B, S)``.

        ``info_dict`` has ``(B, S, ...)`` or ``(B, ...)`` of the columns of ``cfg.wm.encoding``, with or without an axis of time. From the mean of the
        values, their std times ``|mean|`` and ``cfg.wm.uncertainty_penalty`` is taken off.

        Raises:
            ValueError: actions have another dim, or a column is missing.
        """
        rows, samples, _, dim = action_candidates.shape
        if dim != self.action_dim:
            raise ValueError(
                f"candidates [B, S, H, A] = {list(action_candidates.shape)}, blocks of {dim} values; the model takes {self.action_dim}, cfg.action_dim: "
                "plan with PlanConfig(action_block=1)"
            )
        discount, penalty = float(setting(self.cfg, "wm.discount", 0.99)), float(setting(self.cfg, "wm.uncertainty_penalty", 0.5))
        candidates: Any = action_candidates
        z: Any = self._latent(info_dict, 2 if self._has_candidates(info_dict) else 1)
        z = z if z.ndim == 3 else z[:, None]
        z = z.expand(rows, samples, -1).reshape(rows * samples, -1)
        value, weight = 0.0, 1.0
        for action in candidates.to(z.dtype).reshape(rows * samples, *candidates.shape[2:]).unbind(1):
            z, reward = self(z, action)
            value = value + weight * two_hot_inv(reward, self.cfg)
            weight *= discount
        last = torch.cat([z, torch.tanh(self.pi(z).chunk(2, dim=-1)[0])], dim=-1)
        values = torch.stack([two_hot_inv(q(last), self.cfg) for q in cast("Any", self.qs)])
        mean = values.mean(0)
        # The std of a single one is none.
        doubt = values.std(0) if len(values) > 1 else torch.zeros_like(mean)
        return -(value + weight * (mean - penalty * mean.abs() * doubt)).reshape(rows, samples)

    def _has_candidates(self, info: Mapping[str, Any]) -> bool:
        """Whether infos are ``(B, S, ...)``: those of solvers are; the reference takes ``(B, ...)`` without a time, too."""
        key = next(iter(self._encoding()))
        value = torch.as_tensor(self._column(info, key))
        return value.ndim > (4 if key == _PIXELS else 2)


def _convolutions() -> nn.Module:
    parts: list[nn.Module] = []
    channels = 3
    for kernel, stride in _CONVOLUTIONS:
        parts += [cast("Any", nn).Conv2d(channels, _CHANNELS, kernel, stride=stride), cast("Any", nn).Mish()]
        channels = _CHANNELS
    return nn.Sequential(*parts, cast("Any", nn).Flatten())


def _convolved(side: int) -> int:
    """How many values the convolutions make of an image."""
    left = side
    for kernel, stride in _CONVOLUTIONS:
        left = (left - kernel) // stride + 1
        if left < 1:
            raise ValueError(f"cfg.image_size is {side}; the convolutions need 40 or more")
    return _CHANNELS * left * left


def _whole(cfg: Any, path: str) -> int:
    return _positive(setting(cfg, path), path)


def _positive(value: Any, path: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= 1_000_000:
        raise ValueError(f"cfg.{path} is {value!r}; give a whole number from 1 to 1000000")
    return value
