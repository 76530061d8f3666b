"""What configs leave out and shapes tell: encoders that are named alone, policies whose file has the config of a whole training, and
the archive of DINO-WM's authors."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, cast

from . import gcrl, prejepa
from ._frames import frame_mask
from ._images import HALF
from ._names import generation, of_facebook
from ._torch import Tensor, nn, torch
from ._vit import KNOWN, USUAL_HEADS, Vit, VitSizes, without_fixed
from .gcrl.gcrl import EvalOnly, TeacherStudent

__all__ = ["POLICIES", "archive_of", "encoder_of", "policy_of", "world_of"]

POLICIES = ("gcbc", "gciql", "gcivl", "hilp")
_LETTERS = {"s": "small", "b": "base", "l": "large"}


def _below(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name[len(prefix) :]: value for name, value in tensors.items() if name.startswith(prefix)}


def _blocks(names: Mapping[str, Tensor], pattern: str) -> int:
    found = [re.match(pattern, name) for name in names]
    return len({one.group(1) for one in found if one is not None})


def encoder_of(tensors: Mapping[str, Tensor], name: str | None, folder: Path | None, heads: int | None, place: str) -> Vit:
    """An encoder of the sizes that its tensors have.

    Args:
        tensors: Its own, without a prefix.
        name: What the config calls it: a repository, or a folder beside the file.
        folder: Of the file of weights.
        heads: Of attention, which shapes do not have; None: from the name, else from its ``config.json``, else those of the published ones of
            its width.
        place: What errors call it.
    """
    if "embeddings.register_tokens" in tensors:
        raise ValueError(f"{place}: it has registers, which no encoder here has; load such a model with the reference")
    dinov2 = any("layer_scale1" in at for at in tensors)
    beside = {} if name is None or folder is None else _config_beside(folder, name)
    # Frozen, it drops nothing, whatever its config says of training.
    without_fixed({at: value for at, value in beside.items() if "drop" not in at}, dinov2, f"{folder}/{name}/config.json: ")
    try:
        cls, positions = tensors["embeddings.cls_token"], tensors["embeddings.position_embeddings"]
        patches = tensors["embeddings.patch_embeddings.projection.weight"]
        dim, patch, grid = cls.shape[-1], patches.shape[-1], round((positions.shape[1] - 1) ** 0.5)
        hidden = next(value.shape[0] for at, value in tensors.items() if at.endswith(("fc1.weight", "intermediate.dense.weight")))
    except (KeyError, IndexError, StopIteration) as error:
        raise ValueError(f"{place}: the file has no encoder that is known here (a ViT or DINOv2 in the names of transformers)") from error
    if heads is None and name in KNOWN and KNOWN[name].dim == dim:
        heads = KNOWN[name].heads
    if heads is None:
        heads = _heads_of(beside)
    if heads is None:
        heads = USUAL_HEADS.get(dim)
    if heads is None:
        raise ValueError(
            f"{place}: no file says how many heads the attention of this encoder of width {dim} has; give extra_args={{'encoder.heads': N}}"
        )
    sizes = VitSizes(
        dim=dim,
        depth=_blocks(tensors, r"(?:encoder\.layer|layers)\.(\d+)\."),
        heads=heads,
        hidden=hidden,
        patch=patch,
        positions_for=grid * patch,
        dinov2=dinov2,
        names=generation(tensors),
        mask_token="embeddings.mask_token" in tensors,
        pooler="pooler.dense.weight" in tensors,
    )
    return Vit(sizes)


def _config_beside(folder: Path, name: str) -> dict[str, Any]:
    """``config.json`` of the folder beside the weights that a config names, or nothing; nothing outside of ``folder`` is read."""
    file = (folder / name / "config.json").resolve()
    if not file.is_relative_to(folder.resolve()) or not file.is_file() or file.stat().st_size > 1 << 20:
        return {}
    try:
        config: Any = json.loads(file.read_text())
    except ValueError:
        return {}
    return cast("dict[str, Any]", config) if isinstance(config, dict) else {}


def _heads_of(config: Mapping[str, Any]) -> int | None:
    heads = config.get("num_attention_heads")
    return heads if isinstance(heads, int) and 0 < heads <= 1024 else None


def policy_of(tensors: Mapping[str, Tensor], config: Mapping[str, Any], kind: str, folder: Path, extra: Mapping[str, Any]) -> nn.Module:
    """A goal-conditioned policy of the config of its whole training: widths from shapes, heads from the config.

    The values of the first phase (student and teacher) are read as those of the policy's file (frozen).
    """
    sizes = {"heads": extra.get("predictor.heads"), "dim_head": extra.get("predictor.dim_head")}
    settings: Any = config.get("predictor")
    for key in sizes:
        value: Any = sizes[key] or (cast("dict[str, Any]", settings).get(key) if isinstance(settings, Mapping) else None)
        if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= 4096:
            raise ValueError(f"config.json: predictor.{key} is {value!r}; give it as extra_args={{'predictor.{key}': N}}")
        sizes[key] = value
    frozen = any(name.startswith("encoder.backbone.") for name in tensors)
    of_encoder = _below(tensors, "encoder.backbone." if frozen else "encoder.")
    encoder: nn.Module = encoder_of(of_encoder, None, folder, extra.get("encoder.heads"), f"{kind}: encoder")
    extras = _embedders(tensors)
    action = _predictor(_below(tensors, "action_predictor."), sizes, f"{kind}: action_predictor")
    history = action.pos_embedding.shape[1] // action.pos_embedding_goal.shape[1]
    return gcrl.GCRL(
        EvalOnly(encoder) if frozen else encoder,
        action,
        _held(tensors, "value_predictor", sizes, kind),
        _held(tensors, "critic_predictor", sizes, kind),
        nn.ModuleDict(extras) if extras else None,
        history_size=history,
    )


def world_of(tensors: Mapping[str, Tensor], config: Mapping[str, Any], folder: Path, extra: Mapping[str, Any]) -> nn.Module:
    """A PreJEPA of the config of its whole training: sizes from shapes, frames and heads from the config."""

    def value(section: str, key: str) -> Any:
        settings: Any = config.get(section)
        stored = cast("dict[str, Any]", settings).get(key) if isinstance(settings, Mapping) else None
        return extra.get(f"{section}.{key}", stored)

    place = "dino-wm"
    frozen = any(name.startswith("backbone.backbone.") for name in tensors)
    own = _below(tensors, "backbone.backbone." if frozen else "backbone.")
    name = value("backbone", "name")
    encoder: nn.Module = encoder_of(own, name, folder, extra.get("encoder.heads"), f"{place}: encoder")
    predictor = _causal(_below(tensors, "predictor."), value("wm", "history_size"), value("predictor", "heads"), "config.json has wm.history_size", place)
    # Tokens are joined in the order of the config; safetensors sorts its names.
    extras = _embedders(tensors, value("wm", "encoding") or ())
    return prejepa.PreJEPA(EvalOnly(encoder) if frozen else encoder, predictor, nn.ModuleDict(extras) if extras else None, history_size=predictor.num_frames)


def _embedders(tensors: Mapping[str, Tensor], order: Iterable[str] = ()) -> dict[str, nn.Module]:
    """What embeds columns, by column: first those of ``order``, then as in the file."""
    ending = ".patch_embed.weight"
    weights = {name.split(".")[1]: value for name, value in tensors.items() if name.startswith("extra_encoders.") and name.endswith(ending)}
    keys = [*(key for key in order if key in weights), *weights]
    return {key: prejepa.module.Embedder(in_chans=weights[key].shape[1], emb_dim=weights[key].shape[0]) for key in dict.fromkeys(keys)}


def _causal(tensors: Mapping[str, Tensor], frames: Any, heads: Any, where: str, place: str) -> prejepa.module.CausalPredictor:
    """The predictor of a PreJEPA of so many frames and heads; ``where`` has the frames, for the message."""
    try:
        positions, mlp = tensors["pos_embedding"], tensors["transformer.layers.0.1.net.1.weight"]
        inner = tensors["transformer.layers.0.0.to_qkv.weight"].shape[0] // 3
    except KeyError as error:
        raise ValueError(f"{place} lacks predictor.{error.args[0]}; it is of another model, or not whole") from error
    tokens = positions.shape[1]
    side = round((tokens / frames) ** 0.5) if isinstance(frames, int) and frames > 0 else 0
    if side == 0 or side**2 * frames != tokens:
        raise ValueError(f"{place}: {where} {frames}, and its {tokens} positions are not those of as many square images")
    if heads is None and inner == 1024:
        heads = 16
    if not isinstance(heads, int) or heads < 1 or inner % heads:
        raise ValueError(f"{place}: the heads of its predictor, whose attention is {inner} wide, are in no file; give extra_args={{'predictor.heads': N}}")
    return prejepa.module.CausalPredictor(
        num_patches=side**2,
        num_frames=frames,
        dim=positions.shape[2],
        depth=_blocks(tensors, r"transformer\.layers\.(\d+)\."),
        heads=heads,
        dim_head=inner // heads,
        mlp_dim=mlp.shape[0],
    )


# What of the authors' archive is where in the reference's model; its decoder has no part in planning.
_ARCHIVE = {"predictor.": "predictor.", "action_encoder.": "extra_encoders.action.", "proprio_encoder.": "extra_encoders.proprio."}


def archive_of(
    tensors: Mapping[str, Tensor], encoder: Mapping[str, Tensor], settings: Mapping[str, Any], extra: Mapping[str, Any], place: str
) -> tuple[nn.Module, dict[str, Tensor]]:
    """A PreJEPA of the archive of gaoyuezhou/dino_wm, and its tensors under the reference's names.

    Args:
        tensors: Of the archive, by its parts.
        encoder: Of the frozen DINOv2, which the archive does not have.
        settings: Of ``hydra.yaml``, by path.
        extra: What no file says: ``encoder.heads``, ``predictor.heads``.
        place: What errors call the archive.
    """
    found = {ours + name[len(theirs) :]: value for name, value in tensors.items() for theirs, ours in _ARCHIVE.items() if name.startswith(theirs)}
    own = of_facebook(encoder)
    name = re.sub(r"^dinov2_vit([sbl])14$", lambda size: f"facebook/dinov2-{_LETTERS[size[1]]}", str(settings.get("encoder.name")))
    extras = _embedders(found, ("proprio", "action"))
    if set(extras) != {"proprio", "action"}:
        raise ValueError(f"{place} has embeddings of {', '.join(extras) or 'no columns'}; it is no archive of a DINO-WM with proprio and actions, or not whole")
    history, heads = settings.get("num_hist"), extra.get("predictor.heads", settings.get("predictor.heads"))
    with torch.device("meta"):
        backbone = encoder_of(own, name, None, extra.get("encoder.heads"), f"{place}: encoder")
        predictor = _causal(_below(found, "predictor."), history, heads, "hydra.yaml has num_hist", place)
        model = prejepa.PreJEPA(backbone, predictor, nn.ModuleDict(extras), history_size=predictor.num_frames)
    model.image_mean = model.image_std = HALF
    mask = frame_mask(predictor.num_frames, predictor.num_patches, predictor.num_patches).float()
    found |= {f"predictor.transformer.layers.{at}.0.bias": mask for at in range(len(predictor.transformer.layers))}
    return model, {**found, **{f"backbone.{name}": value for name, value in own.items()}}


def _held(tensors: Mapping[str, Tensor], name: str, sizes: Mapping[str, Any], kind: str) -> nn.Module | None:
    """A value or a critic in what holds it: frozen, or a student with its teacher; None where the file has none."""
    own = _below(tensors, f"{name}.")
    if not own:
        return None
    place = f"{kind}: {name}"
    for holder in ("backbone", "student"):
        inner = _below(own, f"{holder}.")
        if inner and holder == "backbone":
            return EvalOnly(_predictor(inner, sizes, place))
        if inner:
            return TeacherStudent(_predictor(inner, sizes, place), _predictor(_below(own, "teacher."), sizes, place))
    return _predictor(own, sizes, place)


def _predictor(tensors: Mapping[str, Tensor], sizes: Mapping[str, Any], place: str) -> Any:
    try:
        goal, frames = tensors["pos_embedding_goal"], tensors["pos_embedding"]
        patches, dim = goal.shape[1], goal.shape[2]
        common: dict[str, Any] = {
            **sizes,
            "num_patches": patches,
            "num_frames": frames.shape[1] // patches,
            "dim": dim,
            "depth": _blocks(tensors, r"transformer\.layers\.(\d+)\."),
            "mlp_dim": tensors["transformer.layers.0.1.net.1.weight"].shape[0],
            "causal": any(name.endswith("causal_mask") for name in tensors),
        }
        if "embed_proj.weight" in tensors:
            return gcrl.module.MetricValuePredictor(**common, embed_dim=tensors["embed_proj.weight"].shape[0])
        common["pool_type"] = "attention" if any(name.endswith("frame_tokens") for name in tensors) else "mean"
        if "q_head.0.weight" in tensors:
            wide, inputs = tensors["q_head.0.weight"].shape
            return gcrl.module.QPredictor(**common, action_dim=inputs - dim, q_hidden_dim=wide)
        return gcrl.module.Predictor(**common, out_dim=tensors["out_proj.weight"].shape[0])
    except (KeyError, IndexError) as error:
        raise ValueError(f"{place}: the file lacks {error}; it is of another model, or not whole") from error
