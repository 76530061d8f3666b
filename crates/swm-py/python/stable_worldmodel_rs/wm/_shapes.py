"""What configs leave out and shapes tell: encoders that are named alone, policies whose file has the config of a whole training, and
the archive of DINO-WM's authors."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from ._config import build
from ._frames import frame_mask
from ._images import HALF
from ._names import generation, of_facebook
from ._torch import Tensor, nn, torch
from ._vit import KNOWN, USUAL_HEADS, Vit, VitSizes, without_fixed

__all__ = ["BACKBONE", "POLICIES", "agent_of", "archive_of", "check_names", "encoder_of", "joint_of", "policy_of", "world_of"]

POLICIES = ("gcbc", "gciql", "gcivl", "hilp")
BACKBONE = "backbone"
"""The folder, beside the weights, of an encoder that has no published name."""
_CLASSES = {"lewm": "LeWM", "pldm": "PLDM"}
_WM = "stable_worldmodel.wm"
_GCRL = f"{_WM}.gcrl.module"
_PREJEPA = f"{_WM}.prejepa.module"
_FROZEN = "stable_pretraining.backbone"
# Of a whole training, what TD-MPC2's model reads.
_AGENT = ("wm", "image_size", "action_dim", "extra_dims", "num_pi_trajs")
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


# Of models of others, how the names of their tensors begin.
_OTHERS = (
    ("level1.", "a model of vladisai/PLDM (MeNet)"),
    ("predictor.action_proj.", "the GCBC of stable-worldmodel 0.0.3"),
    ("predictor.predictor_blocks.", "a predictor of facebookresearch/jepa-wms (jepa_wm, vjepa2_ac)"),
    ("predictor.rnn", "a model of vladisai/PLDM (RNN)"),
)


def check_names(names: Iterable[str], file: Path) -> None:
    """Refuses networks of others by the names of their tensors.

    Raises:
        ValueError: It is one of them.
    """
    # Archives wrap each of their networks apart.
    plain = [re.sub(r"\b(?:module|_orig_mod)\.", "", name) for name in names]
    for begin, what in _OTHERS:
        if any(name.startswith(begin) for name in plain):
            raise ValueError(f"{file} is {what}, which this package does not have; load it by its authors' code")


def _section(config: Mapping[str, Any], name: str) -> dict[str, Any]:
    found: Any = config.get(name)
    return cast("dict[str, Any]", found) if isinstance(found, dict) else {}


def _dropouts(settings: Mapping[str, Any]) -> dict[str, Any]:
    """What a predictor drops in training, where its settings say so."""
    known = {name: settings.get(name) for name in ("dropout", "emb_dropout")}
    return {name: value for name, value in known.items() if isinstance(value, (int, float)) and not isinstance(value, bool)}


def _heads(settings: Mapping[str, Any], extra: Mapping[str, Any], inner: int, place: str) -> dict[str, int]:
    """Heads of a predictor and the dim of each, where its tensors have their product alone: what was given, what its settings say, or the
    published ones where they fit."""
    found = {name: extra.get(f"predictor.{name}", settings.get(name)) for name in ("heads", "dim_head")}
    for name, value in found.items():
        if value is not None and (not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= 4096):
            raise ValueError(f"{place}: predictor.{name} is {value!r}; give it as extra_args={{'predictor.{name}': N}}")
    heads, dim = found["heads"], found["dim_head"]
    if heads is None and dim is not None and inner % dim == 0:
        heads = inner // dim
    if heads is None and dim is None and inner == 1024:
        heads = 16
    if heads is None or inner % heads:
        has = "are in no file" if heads is None else f"are {heads}, which do not divide it"
        raise ValueError(f"{place}: the heads of its predictor, whose attention is {inner} wide, {has}; give extra_args={{'predictor.heads': N}}")
    if dim is not None and heads * dim != inner:
        raise ValueError(
            f"{place}: the predictor has {heads} heads of {dim} values, and the weights have {inner} in all; give extra_args={{'predictor.heads': N, "
            "'predictor.dim_head': M}"
        )
    return {"heads": heads, "dim_head": inner // heads}


def _backbone(vit: Vit, name: object = None, *, frozen: bool = False) -> dict[str, Any]:
    """How a config has an encoder: by a name of which :func:`encoder_of` finds its heads again; ``frozen``, in what keeps it so."""
    own = replace(vit.sizes, names=5, mask_token=True)
    known = [one for one, sizes in KNOWN.items() if sizes == own]
    if not isinstance(name, str) or (name in KNOWN and name not in known) or Path(name).is_absolute() or ".." in Path(name).parts:
        name = known[0] if known else BACKBONE
    node = {"_target_": f"{_PREJEPA}.create_backbone", "name": name}
    return {"_target_": f"{_FROZEN}.EvalOnly", "backbone": node} if frozen else node


def _built(config: dict[str, Any], vit: Vit) -> nn.Module:
    """The model of a config that was made of tensors; its encoder by name is ``vit``."""

    def backbone(place: str, values: Mapping[str, Any]) -> nn.Module:
        return vit

    model: Any = build(config, vit.sizes.names, backbone)
    model.pretrained_config = config
    return cast("nn.Module", model)


def policy_of(tensors: Mapping[str, Tensor], config: Mapping[str, Any], kind: str, folder: Path, extra: Mapping[str, Any]) -> nn.Module:
    """A goal-conditioned policy of the config of its whole training: widths from shapes, heads from the config.

    The values of the first phase are a student and its teacher, those of the policy's file the student, frozen.
    """
    frozen = any(name.startswith("encoder.backbone.") for name in tensors)
    of_encoder = _below(tensors, "encoder.backbone." if frozen else "encoder.")
    vit = encoder_of(of_encoder, None, folder, extra.get("encoder.heads"), f"{kind}: encoder")
    settings = _section(config, "predictor")

    def part(below: Mapping[str, Tensor], name: str) -> dict[str, Any]:
        return _predictor(below, settings, extra, f"{kind}: {name}")

    action = part(_below(tensors, "action_predictor."), "action_predictor")
    model: dict[str, Any] = {
        "_target_": f"{_WM}.gcrl.gcrl.GCRL",
        "history_size": action["num_frames"],
        "encoder": _backbone(vit, frozen=frozen),
        "action_predictor": action,
    }
    for name in ("value_predictor", "critic_predictor"):
        own = _below(tensors, f"{name}.")
        if inner := _below(own, "backbone."):
            model[name] = {"_target_": f"{_FROZEN}.EvalOnly", "backbone": part(inner, name)}
        elif inner := _below(own, "student."):
            model[name] = {"_target_": f"{_FROZEN}.TeacherStudentWrapper", "student": part(inner, name)}
        elif own:
            model[name] = part(own, name)
    return _built({**model, **_embedders(tensors, f"{_GCRL}.Embedder")}, vit)


def joint_of(tensors: Mapping[str, Tensor], config: Mapping[str, Any], kind: str, extra: Mapping[str, Any]) -> nn.Module:
    """A LeWM or PLDM, ``kind``, of the config of its whole training, or of none: sizes from shapes, heads from the config."""
    vit = encoder_of(_below(tensors, "encoder."), None, None, extra.get("encoder.heads"), f"{kind}: encoder")
    home, settings = f"{_WM}.{kind}.module", _section(config, "predictor")

    def mlp(name: str) -> dict[str, Any]:
        own = _below(tensors, f"{name}.net.")
        if not own:
            return {}
        norms = {"1.running_mean": "BatchNorm1d", "1.weight": "LayerNorm"}
        norm = next((found for at, found in norms.items() if at in own), None)
        (hidden, inputs), outputs = own["0.weight"].shape, own["3.weight"].shape[0]
        sizes = {"_target_": f"{home}.MLP", "input_dim": inputs, "hidden_dim": hidden, "output_dim": outputs}
        return {name: {**sizes, "norm_fn": None if norm is None else {"_target_": f"torch.nn.{norm}", "_partial_": True}}}

    try:
        positions, blocks = tensors["predictor.pos_embedding"], _below(tensors, "predictor.transformer.")
        hidden = blocks["norm.weight"].shape[0]
        inner = blocks["layers.0.attn.to_qkv.weight"].shape[0] // 3
        smoothed, block = tensors["action_encoder.patch_embed.weight"].shape[:2]
        emb, wide = tensors["action_encoder.embed.2.weight"].shape
        predictor: dict[str, Any] = {
            "_target_": f"{home}.Predictor",
            "num_frames": positions.shape[1],
            "input_dim": positions.shape[2],
            "hidden_dim": hidden,
            "output_dim": blocks["output_proj.weight"].shape[0] if "output_proj.weight" in blocks else hidden,
            "depth": _blocks(blocks, r"layers\.(\d+)\."),
            "mlp_dim": blocks["layers.0.mlp.net.1.weight"].shape[0],
            **_heads(settings, extra, inner, kind),
            "dropout": 0.1,
            **_dropouts(settings),
        }
        model: dict[str, Any] = {
            "_target_": f"{_WM}.{kind}.{_CLASSES[kind]}",
            "encoder": _vit_hf(vit),
            "predictor": predictor,
            "action_encoder": {"_target_": f"{home}.Embedder", "input_dim": block, "smoothed_dim": smoothed, "emb_dim": emb, "mlp_scale": wide // emb},
            **mlp("projector"),
            **mlp("pred_proj"),
        }
    except KeyError as error:
        raise ValueError(f"{kind}: the file lacks {error}; it is of another model, or not whole") from error
    return _built(model, vit)


def _vit_hf(vit: Vit) -> dict[str, Any]:
    """How a config has an encoder that is trained with its model."""
    sizes = vit.sizes
    if sizes.dinov2 or sizes.pooler:
        return _backbone(vit)
    return {
        "_target_": f"{_FROZEN}.utils.vit_hf",
        "size": "tiny",
        "patch_size": sizes.patch,
        "image_size": sizes.positions_for,
        "pretrained": False,
        "use_mask_token": sizes.mask_token,
        "hidden_size": sizes.dim,
        "num_hidden_layers": sizes.depth,
        "num_attention_heads": sizes.heads,
        "intermediate_size": sizes.hidden,
    }


def world_of(tensors: Mapping[str, Tensor], config: Mapping[str, Any], folder: Path, extra: Mapping[str, Any]) -> nn.Module:
    """A PreJEPA of the config of its whole training: sizes from shapes, frames and heads from the config."""

    def value(section: str, key: str) -> Any:
        return extra.get(f"{section}.{key}", _section(config, section).get(key))

    place = "dino-wm"
    frozen = any(name.startswith("backbone.backbone.") for name in tensors)
    own = _below(tensors, "backbone.backbone." if frozen else "backbone.")
    name = value("backbone", "name")
    vit = encoder_of(own, name, folder, extra.get("encoder.heads"), f"{place}: encoder")
    settings = _section(config, "predictor")
    predictor = _causal(_below(tensors, "predictor."), value("wm", "history_size"), settings, extra, "config.json has wm.history_size", place)
    # Tokens are joined in the order of the config; safetensors sorts its names.
    extras = _embedders(tensors, f"{_PREJEPA}.Embedder", value("wm", "encoding") or ())
    return _built(_prejepa(_backbone(vit, name, frozen=frozen), vit, predictor, extras), vit)


def _prejepa(encoder: dict[str, Any], vit: Vit, predictor: dict[str, Any], extras: dict[str, Any]) -> dict[str, Any]:
    return {
        "_target_": f"{_WM}.PreJEPA",
        "history_size": predictor["num_frames"],
        "num_pred": 1,
        # A DINOv2 interpolates its positions in any case.
        "interpolate_pos_encoding": not vit.sizes.dinov2,
        "encoder": encoder,
        "predictor": predictor,
        **extras,
    }


def agent_of(config: Mapping[str, Any]) -> nn.Module:
    """A TD-MPC2 of the config of its whole training, which has all of its sizes."""
    cfg = {name: config[name] for name in _AGENT if name in config}
    settings: dict[str, Any] = {"_target_": f"{_WM}.tdmpc2.TDMPC2", "_recursive_": False, "cfg": cfg}
    model: Any = build(settings, 5)
    model.pretrained_config = settings
    return cast("nn.Module", model)


def _embedders(tensors: Mapping[str, Tensor], target: str, order: Iterable[str] = ()) -> dict[str, Any]:
    """A config's ``extra_encoders``, what embeds columns: first those of ``order``, then as in the file; nothing where there are none."""
    ending = ".patch_embed.weight"
    weights = {name.split(".")[1]: value for name, value in tensors.items() if name.startswith("extra_encoders.") and name.endswith(ending)}
    keys = dict.fromkeys([*(key for key in order if key in weights), *weights])
    modules = {key: {"_target_": target, "in_chans": weights[key].shape[1], "emb_dim": weights[key].shape[0]} for key in keys}
    return {"extra_encoders": {"_target_": "torch.nn.ModuleDict", "modules": modules}} if modules else {}


def _causal(
    tensors: Mapping[str, Tensor], frames: Any, settings: Mapping[str, Any], extra: Mapping[str, Any], where: str, place: str
) -> dict[str, Any]:
    """The predictor of a PreJEPA of so many frames; ``where`` has the frames, for the message."""
    try:
        positions, mlp = tensors["pos_embedding"], tensors["transformer.layers.0.1.net.1.weight"]
        inner = tensors["transformer.layers.0.0.to_qkv.weight"].shape[0] // 3
    except KeyError as error:
        raise ValueError(f"{place} lacks predictor.{error.args[0]}; it is of another model, or not whole") from error
    tokens = positions.shape[1]
    side = round((tokens / frames) ** 0.5) if isinstance(frames, int) and frames > 0 else 0
    if side == 0 or side**2 * frames != tokens:
        raise ValueError(f"{place}: {where} {frames}, and its {tokens} positions are not those of as many square images")
    return {
        "_target_": f"{_PREJEPA}.CausalPredictor",
        "num_patches": side**2,
        "num_frames": frames,
        "dim": positions.shape[2],
        "depth": _blocks(tensors, r"transformer\.layers\.(\d+)\."),
        "mlp_dim": mlp.shape[0],
        **_heads(settings, extra, inner, place),
        **_dropouts(settings),
    }


# What of the authors' archive is where in the reference's model; its decoder has no part in planning.
_ARCHIVE = {"predictor.": "predictor.", "action_encoder.": "extra_encoders.action.", "proprio_encoder.": "extra_encoders.proprio."}


def archive_of(
    tensors: Mapping[str, Tensor], encoder: Mapping[str, Tensor], settings: Mapping[str, Any], extra: Mapping[str, Any], place: str
) -> tuple[nn.Module, dict[str, Tensor]]:
    """A PreJEPA of the archive of gaoyuezhou/dino_wm, and its tensors under the reference's names.

    Args:
        tensors: Of the archive, by its parts.
        encoder: Of the frozen DINOv2, which the archive does not have.
        settings: Of ``hydra.yaml``.
        extra: What no file says: ``encoder.heads``, ``predictor.heads``.
        place: What errors call the archive.
    """
    found = {ours + name[len(theirs) :]: value for name, value in tensors.items() for theirs, ours in _ARCHIVE.items() if name.startswith(theirs)}
    own = of_facebook(encoder)
    name = re.sub(r"^dinov2_vit([sbl])14$", lambda size: f"facebook/dinov2-{_LETTERS[size[1]]}", str(_section(settings, "encoder").get("name")))
    extras = _embedders(found, f"{_PREJEPA}.Embedder", ("proprio", "action"))
    columns: dict[str, Any] = extras["extra_encoders"]["modules"] if extras else {}
    if set(columns) != {"proprio", "action"}:
        known = ", ".join(columns) or "no columns"
        raise ValueError(f"{place} has embeddings of {known}; it is no archive of a DINO-WM with proprio and actions, or not whole")
    with torch.device("meta"):
        vit = encoder_of(own, name, None, extra.get("encoder.heads"), f"{place}: encoder")
        predictor = _causal(_below(found, "predictor."), settings.get("num_hist"), _section(settings, "predictor"), extra, "hydra.yaml has num_hist", place)
        model: Any = _built(_prejepa(_backbone(vit, name), vit, predictor, extras), vit)
    model.image_mean = model.image_std = HALF
    mask = frame_mask(predictor["num_frames"], predictor["num_patches"], predictor["num_patches"]).float()
    found |= {f"predictor.transformer.layers.{at}.0.bias": mask for at in range(predictor["depth"])}
    return model, {**found, **{f"backbone.{name}": value for name, value in own.items()}}


def _predictor(tensors: Mapping[str, Tensor], settings: Mapping[str, Any], extra: Mapping[str, Any], place: str) -> dict[str, Any]:
    """A policy's predictor, a value or a critic, as a config has it."""
    try:
        goal, frames = tensors["pos_embedding_goal"], tensors["pos_embedding"]
        patches, dim = goal.shape[1], goal.shape[2]
        common: dict[str, Any] = {
            "num_patches": patches,
            "num_frames": frames.shape[1] // patches,
            "dim": dim,
            "depth": _blocks(tensors, r"transformer\.layers\.(\d+)\."),
            "mlp_dim": tensors["transformer.layers.0.1.net.1.weight"].shape[0],
            "causal": any(name.endswith("causal_mask") for name in tensors),
            **_heads(settings, extra, tensors["transformer.layers.0.0.to_q.weight"].shape[0], place),
            **_dropouts(settings),
        }
        if "embed_proj.weight" in tensors:
            return {"_target_": f"{_GCRL}.MetricValuePredictor", **common, "embed_dim": tensors["embed_proj.weight"].shape[0]}
        common["pool_type"] = "attention" if any(name.endswith("frame_tokens") for name in tensors) else "mean"
        if "q_head.0.weight" in tensors:
            wide, inputs = tensors["q_head.0.weight"].shape
            return {"_target_": f"{_GCRL}.QPredictor", **common, "action_dim": inputs - dim, "q_hidden_dim": wide}
        return {"_target_": f"{_GCRL}.Predictor", **common, "out_dim": tensors["out_proj.weight"].shape[0]}
    except (KeyError, IndexError) as error:
        raise ValueError(f"{place}: the file lacks {error}; it is of another model, or not whole") from error
