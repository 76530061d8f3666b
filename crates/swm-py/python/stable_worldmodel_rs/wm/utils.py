"""Models in and out of the files in which they are published: ``weights.pt`` and ``config.json``.

``load_pretrained`` reads what the reference's ``save_pretrained``, its training scripts and Lightning write, and executes nothing of it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from .._access import access_checked

if TYPE_CHECKING:
    from ._torch import Tensor, nn

__all__ = ["download_model", "from_config", "load_pretrained", "save_pretrained"]

_MOST_CONFIG = 1 << 20
# Where DINO-WM's authors keep the last weights in their folder.
_ARCHIVE = Path("checkpoints") / "model_latest.pth"
# What is given as kind, and the class that it is.
_KINDS = {"lewm": "LeWM", "pldm": "PLDM", **dict.fromkeys(("gcbc", "gciql", "gcivl", "hilp"), "GCRL"), "dino-wm": "PreJEPA", "tdmpc2": "TDMPC2"}
# Parts of the names that trainers give, and which kinds these are; the command has the same.
_NAMES = {name: name for name in ("gciql", "gcivl", "hilp", "gcbc", "lewm", "pldm", "tdmpc2")} | dict.fromkeys(("dinowm", "prejepa"), "dino-wm")
_WEIGHTS = (".pt", ".pth", ".ckpt", ".safetensors")


def from_config(config: Mapping[str, Any], *, transformers: int = 5) -> nn.Module:
    """A model with random weights, for training.

    Args:
        config: As in ``config.json``: nested, each part with its ``_target_``.
        transformers: The version, 4 or 5, whose names the tensors of its ViT have.

    Raises:
        ValueError: a class, a setting or a value that is not known here, by its place in the config.
    """
    from ._config import build

    settings = _plain(config)
    model: Any = build(settings, transformers)
    model.pretrained_config = settings
    return cast("nn.Module", model)


@access_checked
def load_pretrained(
    name: str | os.PathLike[str],
    *,
    kind: str | None = None,
    device: str = "cpu",
    cache_dir: str | os.PathLike[str] | None = None,
    extra_args: Mapping[str, Any] | None = None,
    encoder: str | os.PathLike[str] | None = None,
) -> Any:
    """A published model as a torch module, in evaluation: LeWM, PLDM, PreJEPA, TD-MPC2, or a goal-conditioned policy.

    Args:
        name: A file of weights with a ``config.json`` beside it, a folder with one of each, a name below ``$STABLEWM_HOME/checkpoints``,
            or a repository of the Hugging Face Hub that is in a cache. Nothing is fetched; see :func:`download_model`. Or the folder of
            DINO-WM's authors, with ``hydra.yaml`` and ``checkpoints/model_latest.pth``, which becomes a PreJEPA.
        kind: ``"lewm"``, ``"pldm"``, ``"gcbc"``, ``"gciql"``, ``"gcivl"``, ``"hilp"``, ``"dino-wm"`` or ``"tdmpc2"``, where ``config.json`` is that of a
            whole training, or where there is none: sizes are those of the tensors.
        device: Where to.
        cache_dir: In the place of ``$STABLEWM_HOME``, ``~/.stable_worldmodel`` by default.
        extra_args: Other values in the config, by path: ``{"predictor.num_frames": 3}``; ``{"encoder.heads": N}`` where no file says it.
        encoder: The weights of the frozen DINOv2 (``dinov2_vits14_pretrain.pth``), which the folder of DINO-WM's authors does not have.

    Raises:
        FileNotFoundError: nothing of that name is here.
        ValueError: what is there cannot be read as a model; the message has the object, the reason and the fix.
    """
    from .._arguments import device_of, path_of
    from ._beside import see_as_exported
    from ._config import overridden
    from ._shapes import check_names
    from ._weights import read_weights

    name = path_of("the checkpoint", name, "its file, its folder, a name below $STABLEWM_HOME/checkpoints, or 'user/repository'")
    where = device_of("device", device)
    file = _find(name, None if cache_dir is None else Path(cache_dir))
    extra = dict(extra_args or {})
    hydra = (file.parent.parent if file.parent.name == _ARCHIVE.parent.name else file.parent) / "hydra.yaml"
    is_archive = hydra.is_file() and not (file.parent / "config.json").is_file()
    if encoder is not None and not is_archive:
        raise ValueError(f"encoder: {file} has an encoder of its own, or none; leave encoder out")
    named = hydra if is_archive else _config_of(file.parent)
    config = {} if is_archive or named is None else _read_config(named)
    tensors = read_weights(file)
    check_names(tensors, file)
    if is_archive:
        model, tensors = _of_archive(hydra, tensors, file, encoder, extra)
    elif "_target_" in config:
        heads = extra.pop("encoder.heads", None)
        config = overridden(config, extra)
        model = _of_config(config, tensors, file, heads)
        if kind is not None and type(model).__name__ != _KINDS.get(kind):
            raise ValueError(f"kind={kind!r}: {named} is of another model, a {type(model).__name__}; leave kind out")
        cast("Any", model).pretrained_config = config
        see_as_exported(model, file.parent)
    else:
        model = _of_training(config, tensors, named, file, kind, extra)
    _fill(model, tensors, file, "Is config.json of another checkpoint?" if named else f"Is it of another model than {kind}?")
    return cast("Any", model).to(where).eval()


def _of_config(config: Mapping[str, Any], tensors: Mapping[str, Tensor], file: Path, heads: int | None) -> nn.Module:
    from ._config import build
    from ._names import generation
    from ._shapes import encoder_of
    from ._torch import torch

    def backbone(place: str, values: Mapping[str, Any]) -> nn.Module:
        prefix = "backbone." if any(name.startswith("backbone.") for name in tensors) else "encoder."
        own = {name[len(prefix) :].removeprefix("backbone."): value for name, value in tensors.items() if name.startswith(prefix)}
        name = values.get("name")
        return encoder_of(own, str(name) if name else None, file.parent, heads, f"{file}: {place}")

    with torch.device("meta"):
        return build(config, generation(tensors), backbone)


def _of_archive(
    hydra: Path, tensors: Mapping[str, Tensor], file: Path, encoder: str | os.PathLike[str] | None, extra: Mapping[str, Any]
) -> tuple[nn.Module, dict[str, Tensor]]:
    """The model of the archive of DINO-WM's authors."""
    from .._arguments import path_of
    from ._shapes import archive_of
    from ._weights import read_weights

    if encoder is None:
        raise ValueError(f"{file}: the weights of the encoder, a frozen DINOv2, are not in the file; give encoder='dinov2_vits14_pretrain.pth'")
    own = read_weights(Path(path_of("encoder", encoder, "the file of the weights of a DINOv2")))
    return archive_of(tensors, own, _read_config(hydra), extra, str(file))


def _of_training(
    config: Mapping[str, Any], tensors: Mapping[str, Tensor], named: Path | None, file: Path, kind: str | None, extra: Mapping[str, Any]
) -> nn.Module:
    """The model of the config of a whole training, ``named``, or of none; sizes are those of the tensors of ``file``."""
    from ._config import overridden
    from ._shapes import agent_of, joint_of, policy_of, world_of
    from ._torch import torch

    folder = file.parent
    if named is not None and not config:
        raise ValueError(f"{named} is empty; take the one that was published beside the weights")
    if kind is None:
        raise ValueError(_unnamed(config, named, folder))
    if kind not in _KINDS:
        raise ValueError(f"kind {kind!r} is not known; give one of {', '.join(_KINDS)}")
    with torch.device("meta"):
        if kind in ("lewm", "pldm"):
            return joint_of(tensors, config, kind, extra)
        if kind == "dino-wm":
            return world_of(tensors, config, folder, extra)
        if kind == "tdmpc2":
            if named is None:
                raise ValueError(f"{folder} has no config.json, and no other file has the range of rewards of a TD-MPC2; take the one of its training")
            return agent_of(overridden(config, extra))
        return policy_of(tensors, config, kind, folder, extra)


def _unnamed(config: Mapping[str, Any], named: Path | None, folder: Path) -> str:
    """No file says what a checkpoint is of: the error, with the kind that the name of its training has."""
    if named is None:
        return (
            f"{folder} has no config.json, which says what the weights are of; take the one that was published beside them, or give "
            f"kind={' or '.join(map(repr, _KINDS))}"
        )
    name = config.get("output_model_name", "of no name")
    # Policies have the name of their encoder's model before their own.
    kinds = [kind for part, kind in _NAMES.items() if part in str(name)][:1] or list(_KINDS)
    return f"{named} is a training config ({name}), not a model's: it has no _target_; give kind={' or '.join(map(repr, kinds))}"


def _fill(model: nn.Module, tensors: dict[str, Tensor], file: Path, hint: str) -> None:
    """Puts a file's tensors into a model without storage; all of them, or an error, which ends with ``hint``."""
    mine: dict[str, Tensor] = cast("Any", model).state_dict()
    for inner in ("backbone.backbone.", "encoder.backbone."):
        # What holds a frozen encoder in training, and not by the config.
        if not any(name.startswith(inner) for name in mine):
            tensors = {name.replace(inner, inner.removesuffix("backbone."), 1) if name.startswith(inner) else name: value for name, value in tensors.items()}
    given = _renamed(model, tensors)
    lacking, unused = [name for name in mine if name not in given], [name for name in given if name not in mine]
    other = [
        f"{name}: {tuple(given[name].shape)} in the file, {tuple(value.shape)} by config.json"
        for name, value in mine.items()
        if name in given and given[name].shape != value.shape
    ]
    if lacking or unused or other:
        fit = len(mine) - len(lacking) - len(other)
        parts = [f"{what}: {_some(names)}" for what, names in (("missing", lacking), ("not used", unused), ("shapes", other)) if names]
        raise ValueError(f"{file}: {fit} of {len(mine)} tensors fit; {'; '.join(parts)}. {hint}")
    if whole := [name for name, value in mine.items() if value.is_floating_point() and not given[name].is_floating_point()]:
        raise ValueError(
            f"{file}: {_some(whole)} hold whole numbers ({given[whole[0]].dtype}), and models take floats; such weights are quantized: give those before it"
        )
    kept = {name: given[name].to(value.dtype) for name, value in mine.items()}
    cast("Any", model).load_state_dict(kept, assign=True)


def _renamed(model: nn.Module, tensors: Mapping[str, Tensor], transformers: int | None = None) -> dict[str, Tensor]:
    """Tensors under the names that the encoders of ``model`` have, or would have in a version of transformers."""
    from ._names import of_generation
    from ._vit import Vit

    encoders = {f"{path}.": part.sizes for path, part in cast("Any", model).named_modules() if isinstance(part, Vit)}

    def new(name: str) -> str:
        for prefix, sizes in encoders.items():
            if name.startswith(prefix):
                return prefix + of_generation(name[len(prefix) :], transformers or sizes.names, sizes.dinov2)
        return name

    return {new(name): value for name, value in tensors.items()}


def _some(names: Sequence[str], most: int = 5) -> str:
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")


def _config_of(folder: Path) -> Path | None:
    """The file of a checkpoint's config: ``config.json``, or what its training script wrote; None where there is none."""
    files = (folder / name for name in ("config.json", "config.yaml"))
    return next((file for file in files if file.is_file()), None)


def _read_config(file: Path) -> dict[str, Any]:
    """The settings of a file: of a training's, those of the model where it has a class."""
    from .._core import core as _swm

    if file.stat().st_size > _MOST_CONFIG:
        raise ValueError(f"{file} has more than 1 MiB; no model's config has")
    is_yaml = file.suffix == ".yaml"
    try:
        text = file.read_text(encoding="utf-8")
        found: Any = json.loads(_swm.yaml_config(text) if is_yaml else text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{file} is no {'config of Hydra' if is_yaml else 'JSON'}: {error}; fetch it again") from error
    if not isinstance(found, dict):
        raise ValueError(f"{file} holds no settings; take the one that was published beside the weights")
    config = cast("dict[str, Any]", found)
    model = config.get("model")
    is_model = isinstance(model, dict) and "_target_" in model and "num_hist" not in config
    return cast("dict[str, Any]", model) if is_model else config


def _home(cache_dir: Path | None) -> Path:
    root = cache_dir or Path(os.environ.get("STABLEWM_HOME") or Path.home() / ".stable_worldmodel")
    return root / "checkpoints"


def _hub() -> Path:
    if cache := os.environ.get("HF_HUB_CACHE"):
        return Path(cache)
    if home := os.environ.get("HF_HOME"):
        return Path(home) / "hub"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "huggingface" / "hub"


def _find(name: str, cache_dir: Path | None) -> Path:
    """The file of weights of a name."""
    home = _home(cache_dir)
    for path in (Path(name), home / name, home / f"{name}.pt"):
        _refuse_run(path)
        if path.is_file():
            return path
        if path.is_dir():
            return _only(path)
    repository = name.removeprefix("hf:")
    if repository.count("/") == 1 and ".." not in repository:
        flat = "models--" + repository.replace("/", "--")
        if (home / flat).is_dir():
            return _only(home / flat)
        if (found := _snapshot(_hub() / flat)) is not None:
            return _only(found)
        raise FileNotFoundError(
            f"{repository} is neither a path here nor in {home} nor in {_hub()}; fetch it: "
            f"stable_worldmodel_rs.download_model({repository!r}), or `hf download {repository}`"
        )
    raise FileNotFoundError(f"{name} is neither a file nor a folder here, nor in {home}; give the path of a checkpoint")


def _refuse_run(path: Path) -> None:
    """Refuses a run of ``swm train``, or a file of its weights, whose names are other ones."""
    above = (path, path.parent, path.parent.parent)[: 1 if path.suffix not in _WEIGHTS else 3 if path.parent.name == "checkpoints" else 2]
    file = next((folder / "config.json" for folder in above if (folder / "config.json").is_file()), None)
    if file is None or file.stat().st_size > _MOST_CONFIG:
        return
    try:
        found: Any = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return  # An error of its own, later.
    config = cast("dict[str, Any]", found) if isinstance(found, dict) else {}
    if "version" not in config or not ("model_config" in config or "agent" in config):
        return
    model: Any = config.get("model_config")
    if isinstance(model, dict) and cast("dict[str, Any]", model).get("baseline") == "canonical":
        raise ValueError(f"{file.parent} is a run of canonical, which is no world model; load_canonical reads it")
    raise ValueError(
        f"{file.parent} is a run of this program, not a published checkpoint: `swm export {file.parent} --out FOLDER` makes the folder of one; give that"
    )


def _snapshot(folder: Path) -> Path | None:
    """The folder of the files of a repository in the Hub's cache: that of ``main``, else the only one."""
    main = folder / "refs" / "main"
    snapshots = sorted(path for path in (folder / "snapshots").glob("*") if path.is_dir())
    if main.is_file() and (named := folder / "snapshots" / main.read_text().strip()) in snapshots:
        return named
    if len(snapshots) > 1:
        raise ValueError(f"{folder} has several revisions: {', '.join(path.name for path in snapshots)}; give the folder of one")
    return snapshots[0] if snapshots else None


def _only(folder: Path) -> Path:
    """The one file of weights in a folder; ``.pt`` first, as training scripts leave a ``.ckpt`` beside it."""
    if (folder / _ARCHIVE).is_file():
        return folder / _ARCHIVE
    for ending in _WEIGHTS:
        found = sorted(folder.glob(f"*{ending}"))
        if len(found) > 1 and (index := next(folder.glob("*.safetensors.index.json"), None)) and ending == ".safetensors":
            raise ValueError(
                f"{folder} holds its weights in {len(found)} parts ({index.name}), and one file is read; join them: `from safetensors.torch "
                "import load_file, save_file`, then `save_file({k: v for part in PARTS for k, v in load_file(part).items()}, "
                "'weights.safetensors')` into a folder with its config.json"
            )
        if len(found) > 1:
            raise ValueError(f"{folder} holds {len(found)} files of weights: {_some([one.name for one in found])}; give one of them")
        if found:
            return found[0]
    raise ValueError(f"{folder} holds no weights (none of {', '.join(_WEIGHTS)}); give the folder of a checkpoint, or a file")


def _plain(config: Any) -> dict[str, Any]:
    """A config as dicts; OmegaConf's nodes, too."""
    if not isinstance(config, dict) and type(config).__module__.startswith("omegaconf"):
        from importlib import import_module

        config = import_module("omegaconf").OmegaConf.to_container(config, resolve=True)
    if not isinstance(config, Mapping):
        raise TypeError(f"config is {type(config).__name__}; give the settings of the model as a dict with its _target_")
    return {str(key): value for key, value in cast("Mapping[Any, Any]", config).items()}


@access_checked
def save_pretrained(
    model: nn.Module,
    folder: str | os.PathLike[str] | None = None,
    config: Any = None,
    config_key: str | None = None,
    filename: str = "weights.pt",
    cache_dir: str | os.PathLike[str] | None = None,
    *,
    run_name: str | None = None,
    transformers: int | None = None,
) -> Path:
    """Writes ``weights.pt`` and ``config.json``, which :func:`load_pretrained`, ``swm import`` and the reference take; gives the folder.

    Args:
        model: Its state is written without what wraps it (``torch.compile``, several GPUs).
        folder: Made if missing; files of these names are replaced, each as a whole.
        config: What makes the model: a dict, or OmegaConf's node, with ``_target_``. It must fit the model. None: that of a model of
            :func:`load_pretrained` or :func:`from_config`.
        config_key: What makes the model is below this key of ``config``, if it has it.
        filename: Of the weights.
        cache_dir, run_name: The reference's arguments: ``run_name=`` in the place of ``folder`` is a folder below ``checkpoints`` of ``cache_dir``, by
            default ``$STABLEWM_HOME``, where :func:`load_pretrained` finds it by its name.
        transformers: The version, 4 or 5, whose names the encoder's tensors get; None: those that the model has.

    Raises:
        ValueError: the config is of no known model, or of one with other tensors.
    """
    from ._beside import replace_file, write_encoder, write_normalization
    from ._config import build
    from ._torch import torch
    from ._vit import Vit
    from ._weights import unwrapped

    if not callable(getattr(model, "state_dict", None)):
        raise TypeError(f"the model is {type(model).__name__}; give the torch module itself, not its state_dict()")
    state = {name: value.detach().cpu() for name, value in unwrapped(cast("Any", model).state_dict()).items()}
    inner: Any = model
    while hasattr(inner, "_orig_mod") or type(inner).__name__ == "DistributedDataParallel":
        inner = inner._orig_mod if hasattr(inner, "_orig_mod") else inner.module
    known = getattr(inner, "pretrained_config", None)
    if config is None and known is None:
        raise ValueError("config: this model holds none; give the settings that make it, a dict with _target_")
    if (folder is None) == (run_name is None):
        raise TypeError("save_pretrained takes folder, where the model goes, or run_name, a folder below $STABLEWM_HOME/checkpoints; give one of them")
    if cache_dir is not None and run_name is None:
        raise TypeError("cache_dir holds the folders of run_name; give run_name in the place of folder, or leave cache_dir out")
    settings = _plain(known if config is None else config)
    if config_key is not None and isinstance(settings.get(config_key), Mapping):
        settings = _plain(settings[config_key])
    state = _renamed(inner, state, transformers)
    own = [part for part in inner.modules() if isinstance(part, Vit)]

    named: list[str] = []

    def backbone(place: str, values: Mapping[str, Any]) -> nn.Module:
        named.append(str(values.get("name")))
        if not own:
            raise ValueError(f"config: {place} is an encoder by name ({values.get('name')}), and the model has none that is known here")
        return Vit(own[0].sizes)

    with torch.device("meta"):
        wanted: Any = cast("Any", build(settings, 5, backbone)).state_dict()
    of_config = {name: tuple(value.shape) for name, value in _renamed(inner, wanted, transformers).items()}
    of_model = {name: tuple(value.shape) for name, value in state.items()}
    if of_config != of_model:
        other = [name for name in {**of_config, **of_model} if of_config.get(name) != of_model.get(name)]
        raise ValueError(f"config is of a model with other tensors than this one: {_some(other)}; give the one that made it")
    where = Path(folder) if folder is not None else _home(None if cache_dir is None else Path(cache_dir)) / str(run_name)
    if where.exists() and not where.is_dir():
        raise NotADirectoryError(f"{where} is a file; name a folder for the model")
    where.mkdir(parents=True, exist_ok=True)
    draft = where / f".{filename}.{os.getpid()}"
    try:
        torch.save(state, draft)
        os.replace(draft, where / filename)
    finally:
        draft.unlink(missing_ok=True)
    replace_file(where / "config.json", settings)
    for name in named:
        write_encoder(where, name, own[0])
    write_normalization(where, inner)
    return where


def download_model(repo: str, *, revision: str | None = None, cache_dir: str | os.PathLike[str] | None = None) -> Path:
    """Fetches ``config.json`` and the weights of a repository of the Hugging Face Hub into its cache; gives their folder.

    The only function here that fetches. Needs huggingface_hub.

    Args:
        repo: ``"user/repository"``.
        revision: A branch, tag or commit; None: the newest.
        cache_dir: In the place of the Hub's cache.

    Raises:
        ImportError: huggingface_hub is not installed.
    """
    if repo.count("/") != 1:
        raise ValueError(f"{repo!r} is no repository; give 'user/repository'")
    try:
        from importlib import import_module

        hub: Any = import_module("huggingface_hub")
    except ImportError as error:
        raise ImportError("download_model needs huggingface_hub; `pip install huggingface_hub`") from error
    wanted = ["*.json", *(f"*{ending}" for ending in _WEIGHTS)]
    return Path(hub.snapshot_download(repo, revision=revision, cache_dir=cache_dir, allow_patterns=wanted))
