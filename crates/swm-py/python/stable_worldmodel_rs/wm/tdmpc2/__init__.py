"""TD-MPC2: latent dynamics, rewards and values for planning, on vectors and images (arXiv 2310.16828)."""

from __future__ import annotations

from . import module
from .loss import tdmpc2_forward
from .module import NormedLinear, RunningScale, SimNorm, gaussian_logprob, log_std, squash, two_hot, two_hot_inv
from .tdmpc2 import TDMPC2

__all__ = [
    "TDMPC2",
    "NormedLinear",
    "RunningScale",
    "SimNorm",
    "gaussian_logprob",
    "log_std",
    "module",
    "squash",
    "tdmpc2_forward",
    "two_hot",
    "two_hot_inv",
]
