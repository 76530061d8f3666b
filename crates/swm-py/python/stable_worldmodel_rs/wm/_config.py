"""Models of the configs that are published beside weights. A ``_target_`` is looked up in a table: nothing of a config is executed."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any, cast

from . import gcrl, lewm, pldm, prejepa, tdmpc2
from ._torch import nn
from ._vit import vit_hf, without_fixed
from .gcrl.gcrl import EvalOnly, TeacherStudent

__all__ = ["KINDS", "build", "overridden", "target_of"]

_LARGEST = 1_000_000
_DEEPEST = 1_000
_NO_MODULE = "{} is no module; give its settings with a _target_"
_DEPTHS = ("depth", "num_hidden_layers")

_MODELS: dict[str, Any] = {}
for _class, _home in ((lewm.LeWM, "lewm"), (pldm.PLDM, "pldm"), (prejepa.PreJEPA, "prejepa"), (gcrl.GCRL, "gcrl"), (tdmpc2.TDMPC2, "tdmpc2")):
    for _path in (f"wm.{_home}.{_home}", f"wm.{_home}", "wm"):
        _MODELS[f"{_path}.{_class.__name__}"] = _class
_MODELS["jepa.JEPA"] = lewm.LeWM

_MODULES: dict[str, Any] = {
    f"wm.{home}.module.{name}": getattr(module, name)
    for home, module in (("lewm", lewm.module), ("pldm", pldm.module), ("prejepa", prejepa.module), ("gcrl", gcrl.module))
    for name in module.__all__
}
# As the training script of LeWM's authors names them (lucas-maes/le-wm).
_OF_SCRIPT: dict[str, Any] = {
    f"module.{theirs}": getattr(lewm.module, ours) for theirs, ours in (("ARPredictor", "Predictor"), ("Embedder", "Embedder"), ("MLP", "MLP"))
}
_PARTS: dict[str, Any] = _MODULES | _OF_SCRIPT | {
    "stable_pretraining.backbone.utils.vit_hf": vit_hf,
    "stable_pretraining.backbone.EvalOnly": EvalOnly,
    "stable_pretraining.backbone.TeacherStudentWrapper": TeacherStudent,
    "torch.nn.ModuleDict": nn.ModuleDict,
    "torch.nn.Identity": nn.Identity,
}
_PARTIAL: dict[str, Any] = {f"torch.nn.{one.__name__}": one for one in (nn.BatchNorm1d, nn.LayerNorm, nn.GELU, nn.SiLU, nn.ReLU)}

_ROOT = frozenset(inspect.signature(lewm.LeWM).parameters)

KINDS = {"lewm": lewm.LeWM, "pldm": pldm.PLDM, "prejepa": prejepa.PreJEPA, "gcrl": gcrl.GCRL, "tdmpc2": tdmpc2.TDMPC2}
"""Models by the names under which errors list them."""


def target_of(config: Mapping[str, Any]) -> Any:
    """The model that a config names.

    Raises:
        ValueError: it names none that is known here.
    """
    target = config.get("_target_")
    name = _ours(target)
    if name in _MODELS:
        return _MODELS[name]
    raise ValueError(f"config.json: _target_ {target} is no model that this package has; known are {', '.join(KINDS)}")


def _ours(target: object) -> str:
    text = str(target)
    for root in ("stable_worldmodel_rs.", "stable_worldmodel."):
        text = text.removeprefix(root)
    return text


Encoder = Callable[[str, Mapping[str, Any]], nn.Module]
"""What makes the encoder of ``create_backbone``, of its place in the config and its settings."""


def build(config: Mapping[str, Any], names: int, backbone: Encoder | None = None) -> nn.Module:
    """The model of a config, with random weights.

    Args:
        config: Nested, each part with its ``_target_``.
        names: Of a ViT's tensors: those of transformers 4 or 5.
        backbone: See :data:`Encoder`; None: by the name alone.

    Raises:
        ValueError: a class, a setting or a value that is not known here, by its place in the config.
    """
    target_of(config)
    return _Builder(names, backbone).made(config, "")


def overridden(config: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a config with other values, by path: ``{"predictor.num_frames": 3}``."""
    copy: dict[str, Any] = {key: overridden(cast("dict[str, Any]", value), {}) if isinstance(value, dict) else value for key, value in config.items()}
    for path, value in changes.items():
        *above, last = path.split(".")
        node = copy
        for name in above:
            below = node.get(name)
            if not isinstance(below, dict):
                raise ValueError(f"extra_args: the config has no {path}; it has {', '.join(node)} there")
            node = cast("dict[str, Any]", below)
        node[last] = value
    return copy


class _Builder:
    def __init__(self, names: int, backbone: Encoder | None) -> None:
        self.names = names
        self.backbone = backbone

    def made(self, node: Mapping[str, Any], place: str) -> Any:
        if place.count(".") > 32:
            raise ValueError(f"config.json: {place} is nested too deeply; no model is")
        where = place.removesuffix(".") or "the model"
        target = str(node.get("_target_"))
        name = _ours(target)
        settings = {key: value for key, value in node.items() if key not in ("_target_", "_partial_", "_recursive_", "_convert_")}
        if node.get("_partial_"):
            if name not in _PARTIAL or settings:
                raise ValueError(f"config.json: {where}: {target} with _partial_ is not known; known are {', '.join(_PARTIAL)}, as they are")
            return _PARTIAL[name]
        factory = (_MODELS if not place else _PARTS).get(name)
        if factory is None:
            raise ValueError(f"config.json: {where}: {target} is no module of a known model; nothing of a config is executed")
        if not place and factory in (lewm.LeWM, pldm.PLDM):
            # Training scripts keep settings of their own beside the parts, which the reference passes over, too.
            settings = {key: value for key, value in settings.items() if key in _ROOT or not isinstance(value, (int, float, str))}
        values = {key: self._value(value, f"{place}{key}") for key, value in settings.items()}
        if factory is nn.ModuleDict:
            modules: dict[str, Any] = values["modules"] if isinstance(values.get("modules"), dict) else {"modules": None}
            for key, value in modules.items():
                if not isinstance(value, nn.Module):
                    raise ValueError(f"config.json: {where}: {_NO_MODULE.format(key)}")
            return nn.ModuleDict(modules)
        if factory is prejepa.module.create_backbone and self.backbone is not None:
            return self.backbone(where, values)
        if factory is vit_hf:
            values = without_fixed(values, False, f"config.json: {place}")
        _check(factory, values, place)
        if factory is vit_hf:
            values["names"] = self.names
        try:
            return factory(**values)
        except (TypeError, ValueError, RuntimeError, AttributeError) as error:
            raise ValueError(f"config.json: {where}: {error}") from error

    def _value(self, value: Any, place: str) -> Any:
        if isinstance(value, str) and (value == "???" or "${" in value):
            raise ValueError(
                f"config.json: {place} is {value}: an unfinished Hydra config; take the one that training wrote, or give it in extra_args"
            )
        if not isinstance(value, Mapping):
            return value
        node = cast("Mapping[str, Any]", value)
        if "_target_" in node:
            return self.made(node, f"{place}.")
        return {key: self._value(below, f"{place}.{key}") for key, below in node.items()}


def _check(factory: Any, values: Mapping[str, Any], place: str) -> None:
    """Names and types of settings, by the signature."""
    known: dict[str, inspect.Parameter] = dict(inspect.signature(factory).parameters)
    if factory is gcrl.module.QPredictor:
        known = {**dict(inspect.signature(gcrl.module.Predictor).parameters), **known}
        known.pop("out_dim")
    known.pop("names", None)
    open_ended = [name for name, one in known.items() if one.kind is inspect.Parameter.VAR_KEYWORD]
    for name in open_ended:
        del known[name]
    for name, value in values.items():
        if name not in known:
            raise ValueError(f"config.json: {place}{name} is no setting that is known here; known are {', '.join(known)}")
        kind = str(known[name].annotation)
        if value is None and "None" in kind:
            continue
        if "nn.Module" in kind and "Callable" not in kind and not isinstance(value, nn.Module):
            raise ValueError(f"config.json: {_NO_MODULE.format(place + name)}")
        wanted: Any = {"int": int, "float": (int, float), "bool": bool, "str": str}.get(kind.split(" | ")[0])
        if wanted is None:
            continue
        if not isinstance(value, wanted) or (isinstance(value, bool) and wanted is not bool):
            raise ValueError(f"config.json: {place}{name} is {value!r}, and {kind} is wanted")
        if wanted is int:
            number: Any = value
            least, most = (0, _DEEPEST) if name in _DEPTHS else (1, _LARGEST)
            if not least <= number <= most:
                raise ValueError(f"config.json: {place}{name} is {value}; give {least} to {most}")
    lacking = [name for name, one in known.items() if one.default is inspect.Parameter.empty and name not in values]
    if lacking:
        raise ValueError(f"config.json: {place.removesuffix('.') or 'the model'} lacks {', '.join(lacking)}; take the config that training wrote")
