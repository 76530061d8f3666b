"""Losses of LeWM and PLDM, under the reference's names. Embeddings are ``(B, T, D)``, but where another shape is given."""

from __future__ import annotations

from typing import Any

from ._torch import F, Tensor, nn, torch

__all__ = ["PLDMLoss", "SIGReg", "TemporalStraighteningLoss"]


class SIGReg(nn.Module):
    """How far embeddings are from a standard normal distribution, along random directions (arXiv 2511.08544).

    The statistic of Epps and Pulley: the squared difference of the characteristic function of each projection and that of N(0, 1), under a
    Gaussian window, by the trapezoid rule. It is proportional to the rows of a batch.

    Args:
        knots: Points in [0, 3] at which the functions are compared.
        num_proj: Directions, sampled anew in every call.
    """

    t: Tensor
    phi: Tensor
    weights: Tensor

    def __init__(self, knots: int = 17, num_proj: int = 1024) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.num_proj: int = num_proj
        t = torch.linspace(0, 3, knots)
        weights = torch.full((knots,), 2 * 3 / (knots - 1))  # The function is even: both halves of the line.
        weights[[0, -1]] /= 2
        window = torch.exp(-t.square() / 2)
        self.register_buffer("t", t)
        self.register_buffer("phi", window)
        self.register_buffer("weights", weights * window)

    def forward(self, proj: Tensor, directions: Tensor | None = None) -> Tensor:
        """The mean over steps and directions, of embeddings ``(T, B, D)``.

        ``directions``, ``(D, num_proj)``, are sampled where they are not given. In f32, also under autocast: cosines of
        half precision are too coarse.
        """
        with torch.autocast(proj.device.type, enabled=False):
            rows: Any = proj.float()
            along: Any = torch.randn(rows.shape[-1], self.num_proj, device=rows.device) if directions is None else directions
            angles = (rows @ (along / along.norm(dim=0))).unsqueeze(-1) * self.t
            error = (angles.cos().mean(-3) - self.phi).square() + angles.sin().mean(-3).square()
            return ((error @ self.weights) * rows.shape[-2]).mean()


class PLDMLoss(nn.Module):
    """The terms that keep PLDM from collapsing (arXiv 2502.14819): variances, covariances, closeness of states, inverse dynamics."""

    def forward(self, z: Tensor, action_pred: Tensor | None = None, action_target: Tensor | None = None) -> dict[str, Tensor]:
        """``std_loss``, ``std_t_loss``, ``cov_loss``, ``cov_t_loss``, ``temp_align_loss``, and ``idm_loss`` where actions are given."""
        centered = z - z.mean(0, keepdim=True)
        by_step = centered.transpose(0, 1)
        found = {
            "std_loss": _shortfall(by_step),
            "std_t_loss": _shortfall(centered),
            "cov_loss": _covariance(by_step),
            "cov_t_loss": _covariance(centered),
            "temp_align_loss": F.mse_loss(z[:, 1:], z[:, :-1]),
        }
        if action_pred is not None and action_target is not None:
            found["idm_loss"] = F.mse_loss(action_pred, action_target)
        return found


def _shortfall(groups: Tensor) -> Tensor:
    """How far stds fall short of 1, of groups ``(G, N, D)``."""
    return F.relu(1 - (groups.var(1) + 1e-4).sqrt()).mean()


def _covariance(groups: Tensor) -> Tensor:
    """The mean square of covariances off the diagonal, of groups ``(G, N, D)`` that are centered over the batch."""
    count, samples, dim = groups.shape
    products = groups.transpose(1, 2) @ groups / (samples - 1)
    diagonal = products.diagonal(dim1=1, dim2=2)
    return (products.square().sum() - diagonal.square().sum()) / (count * (dim * dim - dim))


class TemporalStraighteningLoss(nn.Module):
    """How much the paths of states turn: minus the cosine of one step and the next (arXiv 2603.12231)."""

    def forward(self, z: Tensor) -> Tensor:
        """The mean over rows and steps."""
        steps = z[:, 1:] - z[:, :-1]
        return -F.cosine_similarity(steps[:, :-1], steps[:, 1:], dim=-1).mean()
