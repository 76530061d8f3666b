"""The world model that LeWM and PLDM share: one vector per image, and a predictor that actions steer.

Shapes: B plans, S candidates, T frames, H blocks, A values of a block of actions, D of a latent.
"""

from __future__ import annotations

from typing import Any, cast

from ._images import normalized
from ._torch import Tensor, nn, torch

__all__ = ["JointModel"]


def _rows(module: nn.Module, states: Tensor) -> Tensor:
    """A module of ``(N, D)``, batch norm for example, on ``(B, T, D)``."""
    return module(states.flatten(0, 1)).unflatten(0, states.shape[:2])


class JointModel(nn.Module):
    """An encoder of images, an embedder of actions, a predictor, and a projector after the first and the last.

    Args:
        encoder: Images ``(N, 3, H, W)`` to an object with ``last_hidden_state``, ``(N, tokens, dim)``; the first token counts.
        predictor: States and embedded actions ``(B, T, D)`` to the states after each.
        action_encoder: Blocks of actions ``(B, T, A)`` to ``(B, T, D)``.
        projector: ``(N, dim)`` to ``(N, D)``; None: the token is the latent.
        pred_proj: The same behind the predictor.
    """

    def __init__(
        self,
        encoder: nn.Module,
        predictor: nn.Module,
        action_encoder: nn.Module,
        projector: nn.Module | None = None,
        pred_proj: nn.Module | None = None,
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.encoder: nn.Module = encoder
        self.predictor: nn.Module = predictor
        self.action_encoder: nn.Module = action_encoder
        self.projector: nn.Module = nn.Identity() if projector is None else projector
        self.pred_proj: nn.Module = nn.Identity() if pred_proj is None else pred_proj

    @property
    def image_size(self) -> int | None:
        """The side of the images that the encoder was made for, if it has one."""
        sizes = getattr(self.encoder, "sizes", None)
        return None if sizes is None else sizes.positions_for

    @property
    def history(self) -> int:
        """The most frames that the predictor sees."""
        table = getattr(self.predictor, "pos_embedding", None)
        return 3 if table is None else table.shape[1]

    def encode(self, info: Any) -> Any:
        """Adds ``emb``, ``(B, T, D)``, to a dict with ``pixels``, and ``act_emb`` where it has ``action``, ``(B, T, A)``.

        ``pixels`` are floats ``(B, T, 3, H, W)``, or bytes, which are normalized and resized here. Images without a dict,
        ``(B, H, W, 3)``, give their latents, ``(B, D)``.
        """
        if not isinstance(info, dict):
            images = torch.as_tensor(info)
            return self.encode({"pixels": images[:, None]})["emb"][:, 0]
        found = cast("dict[str, Any]", info)
        where: Any = next(self.parameters())
        pixels = normalized(found["pixels"], self.image_size).to(where.device, where.dtype)
        seen = self.encoder(pixels.flatten(0, 1), interpolate_pos_encoding=True).last_hidden_state[:, 0]
        found["emb"] = self.projector(seen).unflatten(0, pixels.shape[:2])
        if "action" in found:
            found["act_emb"] = self.action_encoder(found["action"].to(where.device))
        return found

    def predict(self, emb: Tensor, act_emb: Tensor) -> Tensor:
        """The state after each of ``emb``, ``(B, T, D)``, under embedded actions ``(B, T, D)``."""
        return _rows(self.pred_proj, self.predictor(emb, act_emb))

    def rollout(self, info: dict[str, Any], action_sequence: Tensor, history_size: int | None = None) -> dict[str, Any]:
        """Adds ``predicted_emb``, ``(B, S, N + 1, D)``, for N blocks: the T encoded frames, and the states after them.

        ``info["pixels"]`` are ``(B, S, T, ...)``, the same for all S. Of ``action_sequence``, ``(B, S, N, A)``, the first T - 1 blocks
        lie between these frames, as the reference has it; where ``info`` has them as ``action_history``, ``(B, S, T - 1, A)``, they
        are put before it. Encoded frames stay in ``info["emb"]`` for the next call.
        """
        count = action_sequence.shape[1]
        self._observe(info, count)
        states = info["emb"][:, :1].expand(-1, count, -1, -1).flatten(0, 1)
        actions = action_sequence.to(states.device)
        if "action_history" in info:
            before = info["action_history"][:, :1].to(actions)
            actions = torch.cat([before.expand(-1, count, -1, -1), actions], dim=2)
        embedded = self.action_encoder(actions.flatten(0, 1))
        window = history_size or self.history
        for end in range(states.shape[1], actions.shape[2] + 1):
            start = max(0, end - window)
            following = self.predict(states[:, start:end], embedded[:, start:end])[:, -1:]
            states = torch.cat([states, following], dim=1)
        info["predicted_emb"] = states.unflatten(0, (-1, count))
        return info

    def _observe(self, info: dict[str, Any], count: int) -> None:
        """Encodes the frames, if that was not done."""
        if "emb" not in info:
            frames = self.encode({"pixels": info["pixels"][:, 0]})["emb"]
            info["emb"] = frames[:, None].expand(-1, count, -1, -1)

    def criterion(self, info_dict: dict[str, Any]) -> Tensor:
        """The squared distance ``(B, S)`` of the last predicted state from ``goal_emb``, ``(B, T, D)``."""
        goal = info_dict["goal_emb"][..., -1:, :].detach()
        if goal.ndim == 3:
            goal = goal[:, None]
        return (info_dict["predicted_emb"][:, :, -1:] - goal).square().sum((-2, -1))

    def get_cost(self, info_dict: dict[str, Any], action_candidates: Tensor) -> Tensor:
        """The cost ``(B, S)`` of candidates ``(B, S, H, A)``: how far from ``info["goal"]``, ``(B, S, 1, ...)``, each of them ends.

        Its derivative is that of the candidates: what is encoded is kept in ``info_dict`` for the next call, without a graph.
        """
        with torch.no_grad():
            if "goal_emb" not in info_dict:
                info_dict["goal_emb"] = self.encode({"pixels": info_dict["goal"][:, 0]})["emb"]
            self._observe(info_dict, action_candidates.shape[1])
        return self.criterion(self.rollout(info_dict, action_candidates))
