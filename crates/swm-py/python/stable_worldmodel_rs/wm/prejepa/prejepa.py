"""PreJEPA, the reference's DINO-WM (arXiv 2411.04983): a world model over the tokens of a frozen DINOv2.

Shapes: B plans, S candidates, T frames, P patches, W dims of a token with everything that joins it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .._frames import TokenModel
from .._torch import Tensor, nn, torch

__all__ = ["PreJEPA"]


class PreJEPA(TokenModel):
    """The model.

    Args:
        encoder: Images to tokens, a DINOv2; the first token is left out.
        predictor: ``(B, T × P, W)`` to the same, one frame later.
        extra_encoders: Of columns that join every token, such as ``proprio``, and of ``action``.
        decoder: Must be None: none is known here.
        history_size: Frames that the predictor is given at most.
        num_pred: Frames between a frame and the one that training compares its prediction with. Of no effect here, as in the reference.
        interpolate_pos_encoding: Of no effect: positions are interpolated where images have another size.
    """

    _encoder_name = "backbone"

    def __init__(
        self,
        encoder: nn.Module,
        predictor: nn.Module,
        extra_encoders: Mapping[str, nn.Module] | nn.Module | None = None,
        decoder: None = None,
        history_size: int = 3,
        num_pred: int = 1,
        interpolate_pos_encoding: bool = True,
    ) -> None:
        super().__init__(encoder, extra_encoders)
        if decoder is not None:
            raise ValueError("PreJEPA: a decoder is not known here; leave it out")
        self.predictor: nn.Module = predictor
        self.history_size: int = history_size
        self.num_pred: int = num_pred
        self.interpolate_pos_encoding: bool = interpolate_pos_encoding

    def _patches(self) -> int | None:
        return getattr(self.predictor, "num_patches", None)

    def predict(self, embedding: Tensor) -> Tensor:
        """The frame after each: ``(B, T, P, W)`` to the same."""
        return self.predictor(embedding.flatten(1, 2)).unflatten(1, embedding.shape[1:3])

    def split_embedding(self, embedding: Tensor, extra_dims: Mapping[str, int]) -> dict[str, Tensor]:
        """The parts of joined tokens ``(..., P, W)``: ``pixels_emb``, and of each key the first token's, ``<key>_emb``, ``(..., dim)``."""
        tokens: Any = embedding
        rest = tokens.shape[-1] - sum(extra_dims.values())
        pixels, *extras = tokens.split([rest, *extra_dims.values()], dim=-1)
        found = {f"{key}_emb": part[..., 0, :] for key, part in zip(extra_dims, extras, strict=True)}
        return {"pixels_emb": pixels, **found}

    def replace_action_in_embedding(self, embedding: Tensor, act: Tensor) -> Tensor:
        """Joined tokens ``(B, T, P, W)`` with what blocks of actions ``(B, T, A)`` are embedded as in the place of their own."""
        dims = self._extra_dims()
        tokens: Any = embedding
        rest = tokens.shape[-1] - sum(dims.values())
        parts: dict[str, Any] = dict(zip(["", *dims], tokens.split([rest, *dims.values()], dim=-1), strict=True))
        embedded = self.extra_encoders["action"](act)
        parts["action"] = embedded[:, :, None].expand(-1, -1, embedding.shape[2], -1)
        return torch.cat(list(parts.values()), dim=-1)

    def rollout(self, info: dict[str, Any], action_sequence: Tensor) -> dict[str, Any]:
        """Adds ``predicted_embedding``, also as ``predicted_emb``, ``(B, S, N + 1, P, W)``, for N blocks ``(B, S, N, A)``.

        ``info`` has ``pixels`` and the columns of the extra encoders, ``(B, S, T, ...)``, the same for all S. The first T - 1 blocks lie
        between these frames, as the reference has it; where ``info`` has them as ``action_history``, they are put before. Frames are
        joined with the block that follows them, the last with what the model predicts there.
        """
        count = action_sequence.shape[1]
        start = self._observe(info)
        actions = action_sequence.to(start.device)
        if "action_history" in info:
            before = info["action_history"][:, :1].to(actions)
            actions = torch.cat([before.expand(-1, count, -1, -1), actions], dim=2)
        actions = actions.flatten(0, 1)
        frames = self._with_room(start)[:, None].expand(-1, count, -1, -1, -1).flatten(0, 1)
        seen = frames.shape[1]
        frames = self.replace_action_in_embedding(frames, actions[:, :seen])
        for end in range(seen, actions.shape[1] + 1):
            following = self.predict(frames[:, max(0, end - self.history_size) :])[:, -1:]
            if end < actions.shape[1]:
                following = self.replace_action_in_embedding(following, actions[:, end : end + 1])
            frames = torch.cat([frames, following], dim=1)
        info["predicted_embedding"] = info["predicted_emb"] = frames.unflatten(0, (-1, count))
        return info

    def _observe(self, info: dict[str, Any]) -> Tensor:
        """The tokens of the frames, encoded once."""
        keys = [key for key in self._extra_dims() if key != "action"]
        if "_start" not in info:
            columns = {key: info[key][:, 0] for key in ("pixels", *keys)}
            info["_start"] = self.encode(columns, emb_keys=keys)["emb"]
        return info["_start"]

    def _with_room(self, observed: Tensor) -> Tensor:
        """Tokens of observed frames with zeros where the actions' part belongs."""
        dims = self._extra_dims()
        tokens: Any = observed
        rest = tokens.shape[-1] - sum(dim for key, dim in dims.items() if key != "action")
        widths = [rest, *(dim for key, dim in dims.items() if key != "action")]
        parts: dict[str, Any] = dict(zip(["", *(key for key in dims if key != "action")], tokens.split(widths, dim=-1), strict=True))
        room = observed.new_zeros(*observed.shape[:-1], dims["action"])
        return torch.cat([parts[key] if key in parts else room for key in ("", *dims)], dim=-1)

    def criterion(self, info_dict: dict[str, Any], action_candidates: Tensor | None = None) -> Tensor:
        """The cost ``(B, S)``: the mean squared distance of the last predicted tokens from ``goal_emb``'s, and of the first token's
        other columns."""
        dims = self._extra_dims()
        last = self.split_embedding(info_dict["predicted_embedding"][:, :, -1], dims)
        without = {key: dim for key, dim in dims.items() if key != "action"}
        goal = self.split_embedding(info_dict["goal_emb"][:, -1:].detach(), without)
        return sum((last[key] - part).square().flatten(2).mean(-1) for key, part in goal.items())  # pyright: ignore[reportReturnType]

    def get_cost(self, info_dict: dict[str, Any], action_candidates: Tensor) -> Tensor:
        """The cost ``(B, S)`` of candidates ``(B, S, H, A)``: how far from ``goal`` and ``goal_<key>`` each of them ends.

        Its derivative is that of the candidates: what is encoded is kept in ``info_dict`` for the next call, without a graph.
        """
        with torch.no_grad():
            if "goal_emb" not in info_dict:
                keys = [key for key in self._extra_dims() if key != "action"]
                goal = {name: info_dict[name][:, 0] for name in ("goal", *(f"goal_{key}" for key in keys))}
                found = self.encode(goal, pixels_key="goal", prefix="goal_", emb_keys=keys, target="goal_emb")
                info_dict["goal_emb"] = found["goal_emb"]
            self._observe(info_dict)
        return self.criterion(self.rollout(info_dict, action_candidates), action_candidates)
