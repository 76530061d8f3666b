"""Goal-conditioned policies over the tokens of a frozen DINOv2: GCBC, GCIQL, GCIVL and HILP, which differ in how they learn.

Shapes: B rows, T frames, P patches, W dims of a token with everything that joins it, A values of an action.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

from .._frames import TokenModel
from .._torch import Tensor, nn, torch

__all__ = ["GCRL", "EvalOnly", "TeacherStudent"]


class EvalOnly(nn.Module):
    """A module that is used and not trained; its tensors are below ``backbone``."""

    def __init__(self, backbone: nn.Module) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.backbone: nn.Module = backbone.eval()
        self.backbone.requires_grad_(False)

    def train(self, mode: bool = True) -> EvalOnly:
        """Stays as it is in evaluation."""
        self.training = False
        return self

    def forward(self, *inputs: Any, **options: Any) -> Any:
        """As the module does."""
        return self.backbone(*inputs, **options)


class TeacherStudent(nn.Module):
    """A module that is trained, ``student``, and a copy that follows it, ``teacher``. The student is what is used.

    Args:
        student: The module.
        warm_init: Of no effect here: the teacher begins as the student in any case.
        base_ema_coefficient, final_ema_coefficient: How much of the teacher a step of training keeps, at its begin and at its end. Files hold them.
    """

    def __init__(
        self, student: nn.Module, warm_init: bool = True, base_ema_coefficient: float = 0.996, final_ema_coefficient: float = 1.0
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.student: nn.Module = student
        self.teacher: nn.Module = deepcopy(student).requires_grad_(False)
        self.register_buffer("base_ema_coefficient", torch.tensor(base_ema_coefficient))
        self.register_buffer("final_ema_coefficient", torch.tensor(final_ema_coefficient))
        self.register_buffer("ema_coefficient", torch.tensor(base_ema_coefficient))

    def forward(self, *inputs: Any, **options: Any) -> Any:
        """As the student does."""
        return self.student(*inputs, **options)


class GCRL(TokenModel):
    """Encoder, policy, and what it learned from.

    Args:
        encoder: Images to tokens; the first token is left out.
        action_predictor: Frames ``(B, T × P, W)`` and goal ``(B, P, W)`` to actions ``(B, T, A)``.
        value_predictor: The same to values ``(B, T, 1)``.
        critic_predictor: Frames, actions and goal to values.
        extra_encoders: Of columns that join every token, such as ``proprio``.
        history_size: Frames that the policy is given.
        interpolate_pos_encoding: Of no effect: positions are interpolated where images have another size.
        log_std_min, log_std_max: Bounds of ``log_stds``.
    """

    def __init__(
        self,
        encoder: nn.Module,
        action_predictor: nn.Module,
        value_predictor: nn.Module | None = None,
        critic_predictor: nn.Module | None = None,
        extra_encoders: Mapping[str, nn.Module] | nn.Module | None = None,
        history_size: int = 3,
        interpolate_pos_encoding: bool = True,
        log_std_min: float = -5.0,
        log_std_max: float = 2.0,
    ) -> None:
        super().__init__(encoder, extra_encoders)
        predictor: Any = action_predictor
        self.action_predictor: nn.Module = action_predictor
        self.value_predictor: Any = value_predictor
        self.critic_predictor: Any = critic_predictor
        self.history_size: int = history_size
        self.interpolate_pos_encoding: bool = interpolate_pos_encoding
        self.log_std_min: float = log_std_min
        self.log_std_max: float = log_std_max
        self.log_stds: Tensor = nn.Parameter(torch.zeros(predictor.out_proj.weight.shape[0]))

    def _patches(self) -> int | None:
        positions = getattr(self.action_predictor, "pos_embedding_goal", None)
        return None if positions is None else positions.shape[1]

    def encode(self, info: dict[str, Any], *rest: Any, target: str = "embed", **options: Any) -> dict[str, Any]:
        """As :meth:`TokenModel.encode`, with ``embed`` for a name."""
        return super().encode(info, *rest, target=target, **options)

    def predict_actions(self, embedding: Tensor, embedding_goal: Tensor, temperature: float = 1.0) -> tuple[Tensor, Tensor]:
        """Means ``(B, T, A)`` and stds ``(A,)`` of actions, of tokens ``(B, T, P, W)`` and ``(B, 1, P, W)``."""
        means = self.action_predictor(embedding.flatten(1, 2), embedding_goal.flatten(1, 2))
        return means, self.log_stds.clamp(self.log_std_min, self.log_std_max).exp() * temperature

    def predict_values(self, embedding: Tensor, embedding_goal: Tensor) -> Tensor:
        """Values ``(B, T, 1)``."""
        if self.value_predictor is None:
            raise ValueError("this model has no value_predictor; it was trained to imitate alone")
        return self.value_predictor(embedding.flatten(1, 2), embedding_goal.flatten(1, 2))

    def get_action(self, info: dict[str, Any], sample: bool = False, temperature: float = 1.0) -> Tensor:
        """The action ``(B, A)`` after the last frame: its mean, or a sample.

        ``info`` has ``pixels`` ``(B, T, ...)``, ``goal`` ``(B, 1, ...)``, and the columns of the extra encoders with their ``goal_<key>``.
        What is encoded is added to it.
        """
        keys = list(self._extra_dims())
        self.encode(info, emb_keys=keys)
        self.encode(info, pixels_key="goal", prefix="goal_", emb_keys=keys, target="goal_embed")
        means, stds = self.predict_actions(info["embed"], info["goal_embed"], temperature)
        last = means[:, -1]
        return last + stds * torch.randn_like(last) if sample else last
