"""A run of ``swm train canonical`` as a torch module."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any, cast

from ..._access import access_checked
from ..._arguments import device_of, path_of
from .._weights import read_weights
from .canonical import Canonical

__all__ = ["load_canonical"]

_STEP = re.compile(r"step-(\d+)\.safetensors")
_MOST_CONFIG = 1 << 20


@access_checked
def load_canonical(run: str | os.PathLike[str], *, checkpoint: int | None = None, device: str = "cpu") -> Canonical:
    """The network of a run of the baseline ``canonical``, in evaluation.

    Args:
        run: The folder, with ``config.json`` and ``checkpoints/step-*.safetensors``.
        checkpoint: The step; None: the last one.
        device: Where to.

    Raises:
        FileNotFoundError: There is no run, or no such checkpoint.
        ValueError: It is a run of another baseline, or its weights are not those of its config.
    """
    folder = Path(path_of("the run", run, "the folder that `swm train canonical --out` made"))
    where = device_of("device", device)
    file = folder / "config.json"
    if not file.is_file():
        raise FileNotFoundError(f"{folder} has no config.json: it is no run; `swm train canonical --out {folder}` makes one")
    model = _made(file)
    weights = _checkpoint(folder, checkpoint)
    tensors = {name.replace("network.half.", "network.to_half."): value for name, value in read_weights(weights).items()}
    mine: dict[str, Any] = cast("Any", model).state_dict()
    wrong = [name for name in {**mine, **tensors} if name not in mine or name not in tensors or mine[name].shape != tensors[name].shape]
    if wrong:
        raise ValueError(f"{weights}: {', '.join(wrong[:5])} {'is' if len(wrong) == 1 else 'are'} not of the network in config.json; is it of another run?")
    cast("Any", model).load_state_dict(tensors)
    return cast("Any", model).to(where).eval()


def _made(file: Path) -> Canonical:
    if file.stat().st_size > _MOST_CONFIG:
        raise ValueError(f"{file} has more than 1 MiB; no run's config has")
    try:
        config: Any = json.loads(file.read_text(encoding="utf-8"))
        found: dict[str, Any] = config["model_config"]
        baseline, settings = found["baseline"], found["settings"]["model"]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"{file} is no config of a run: {error!r}; give the folder that `swm train canonical --out` made") from error
    if baseline != "canonical":
        raise ValueError(f"{file.parent} is a run of {baseline}, and load_canonical reads those of canonical; `mpc:{file.parent}` plans with it")
    try:
        return Canonical(int(settings["image"]), [int(one) for one in settings["channels"]], int(settings["frames"]))
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{file}: model: {error}; take the config that training wrote") from error


def _checkpoint(folder: Path, step: int | None) -> Path:
    found = {int(name[1]): path for path in (folder / "checkpoints").glob("step-*.safetensors") if (name := _STEP.fullmatch(path.name))}
    if not found:
        raise FileNotFoundError(f"{folder} has no checkpoints/step-*.safetensors: the run has not saved one yet")
    if step is not None and step not in found:
        raise FileNotFoundError(f"{folder} has no checkpoint of step {step}; it has {', '.join(map(str, sorted(found)))}")
    return found[max(found) if step is None else step]
