"""The parts of TD-MPC2: numbers as distributions over bins, layers, and the scale of values.

Attributes have the names that the reference's files of weights have. Settings are those of its configs: ``cfg.wm.num_bins``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from .._torch import F, Tensor, nn, torch

__all__ = [
    "NormedLinear",
    "RunningScale",
    "SimNorm",
    "gaussian_logprob",
    "log_std",
    "mlp",
    "setting",
    "squash",
    "symexp",
    "symlog",
    "two_hot",
    "two_hot_inv",
]

_MISSING: Any = object()
_HALF_LOG_TWO_PI = 0.9189385332046727
# Of an action that reaches its bound, the logarithm stays finite.
_LEAST = 1e-6


def setting(cfg: Any, path: str, default: Any = _MISSING) -> Any:
    """A setting by its path, ``"wm.num_bins"``, of a dict, a namespace, or a node of OmegaConf.

    Raises:
        ValueError: There is none, and no default.
    """
    node = cfg
    for name in path.split("."):
        if isinstance(node, Mapping):
            found: Any = cast("Mapping[str, Any]", node).get(name, _MISSING)
        else:
            found = getattr(node, name, _MISSING)
        # A node of OmegaConf gives None for what it does not have.
        if found is _MISSING or (found is None and default is not _MISSING):
            if default is _MISSING:
                raise ValueError(f"cfg has no {path}; take the config that training wrote")
            return default
        node = found
    return node


def _bins(cfg: Any) -> tuple[float, float, int]:
    return float(setting(cfg, "wm.vmin")), float(setting(cfg, "wm.vmax")), int(setting(cfg, "wm.num_bins"))


def symlog(x: Tensor) -> Tensor:
    """The logarithm of 1 + |x|, with the sign of x."""
    return torch.sign(x) * torch.log1p(torch.abs(x))


def symexp(x: Tensor) -> Tensor:
    """The inverse of :func:`symlog`."""
    return torch.sign(x) * torch.expm1(torch.abs(x))


def two_hot(x: Tensor, cfg: Any) -> Tensor:
    """Numbers ``(B,)`` or ``(B, 1)`` as weights of the two bins around their :func:`symlog`, ``(B, num_bins)``."""
    low, high, count = _bins(cfg)
    values: Any = x.reshape(-1, 1)
    place = (symlog(values).clamp(low, high) - low) * ((count - 1) / (high - low))
    below = place.floor().clamp(0, count - 2)
    above = place - below
    weights = values.new_zeros(values.shape[0], count)
    weights.scatter_(1, below.long(), 1 - above)
    return weights.scatter_(1, below.long() + 1, above)


def two_hot_inv(logits: Tensor, cfg: Any) -> Tensor:
    """The numbers ``(..., 1)`` that logits of bins ``(..., num_bins)`` mean."""
    low, high, count = _bins(cfg)
    centers = torch.linspace(low, high, count, device=logits.device, dtype=logits.dtype)
    return symexp((F.softmax(logits, dim=-1) * centers).sum(-1, keepdim=True))


def log_std(x: Tensor, low: float = -10, dif: float = 12) -> Tensor:
    """Any number as the logarithm of a std from ``low`` to ``low + dif``."""
    return low + dif * (torch.tanh(x) + 1) / 2


def gaussian_logprob(eps: Tensor, log_std: Tensor) -> Tensor:
    """The log density ``(..., 1)`` of a normal sample that is ``eps`` ``(..., A)`` stds from its mean."""
    return (-(eps * eps) / 2 - log_std - _HALF_LOG_TWO_PI).sum(-1, keepdim=True)


def squash(mu: Tensor, pi: Tensor, log_pi: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Mean and sample within -1 to 1 by tanh, and the log density of that sample."""
    mean, sample = torch.tanh(mu), torch.tanh(pi)
    slope: Any = F.relu(1 - sample * sample) + _LEAST
    return mean, sample, log_pi - slope.log().sum(-1, keepdim=True)


class SimNorm(nn.Module):
    """Groups of values as distributions: a softmax over every ``simnorm_dim`` of them."""

    def __init__(self, cfg: Any) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.simplex_dim: int = int(setting(cfg, "wm.simnorm_dim", 8))

    def forward(self, x: Tensor) -> Tensor:
        """``(..., Z)`` to the same."""
        flat: Any = x
        return F.softmax(flat.unflatten(-1, (-1, self.simplex_dim)), dim=-1).flatten(-2)


class NormedLinear(nn.Linear):
    """A linear layer, dropout, a layer norm, and an activation: Mish unless another is given."""

    def __init__(self, in_features: int, out_features: int, bias: bool = True, dropout: float = 0.0, act: nn.Module | None = None) -> None:
        super().__init__(in_features, out_features, bias=bias)
        self.ln: nn.Module = nn.LayerNorm(out_features)
        self.act: nn.Module = cast("Any", nn).Mish() if act is None else act
        self.dropout: nn.Module | None = nn.Dropout(dropout) if dropout else None

    def forward(self, input: Tensor) -> Tensor:
        """``(..., in_features)`` to ``(..., out_features)``."""
        x: Any = super().forward(input)
        return self.act(self.ln(x if self.dropout is None else self.dropout(x)))


class RunningScale(nn.Module):
    """The range of values from their 5 % to their 95 % quantile, as a moving average: ``value`` ``(1,)``."""

    value: Tensor

    def __init__(self, tau: float = 0.01) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.tau: float = tau
        self.register_buffer("value", torch.full((1,), 10.0))

    def update(self, x: Tensor) -> None:
        """Follows the values of a batch."""
        quantiles = torch.quantile(x.detach().float(), torch.tensor([0.05, 0.95], device=x.device))
        with torch.no_grad():
            cast("Any", self.value).lerp_((quantiles[1:] - quantiles[:1]).clamp(min=1e-4), self.tau)

    def forward(self, x: Tensor, update: bool = False) -> Tensor:
        """Values in units of the range."""
        if update:
            self.update(x)
        return x / self.value


def mlp(in_dim: int, mlp_dim: int, out_dim: int, act: nn.Module | None = None, dropout: float = 0.0) -> nn.Module:
    """Two layers of ``mlp_dim`` and one of ``out_dim``, which has a norm if it has an activation."""
    last = nn.Linear(mlp_dim, out_dim) if act is None else NormedLinear(mlp_dim, out_dim, act=act)
    return nn.Sequential(NormedLinear(in_dim, mlp_dim, dropout=dropout), NormedLinear(mlp_dim, mlp_dim), last)
