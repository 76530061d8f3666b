"""World models as torch modules, under the reference's names, and the files in which they are published.

Names are loaded when they are first used: torch is imported with the first model.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from . import gcrl, lewm, loss, pldm, prejepa, tdmpc2, utils
    from .gcrl import GCRL
    from .lewm import LeWM
    from .pldm import PLDM
    from .prejepa import PreJEPA
    from .tdmpc2 import TDMPC2
    from .utils import download_model, from_config, load_pretrained, save_pretrained

__all__ = [
    "GCRL",
    "PLDM",
    "TDMPC2",
    "LeWM",
    "PreJEPA",
    "download_model",
    "from_config",
    "gcrl",
    "lewm",
    "load_pretrained",
    "loss",
    "pldm",
    "prejepa",
    "save_pretrained",
    "tdmpc2",
    "utils",
]

_MODULES = frozenset({"gcrl", "lewm", "loss", "pldm", "prejepa", "tdmpc2", "utils"})
_CLASSES = {"GCRL": "gcrl", "LeWM": "lewm", "PLDM": "pldm", "PreJEPA": "prejepa", "TDMPC2": "tdmpc2"}
_HOMES = _CLASSES | dict.fromkeys(("download_model", "from_config", "load_pretrained", "save_pretrained"), "utils")


if not TYPE_CHECKING:
    # Type checkers would take any name for granted.
    def __getattr__(name: str) -> object:
        if name in _MODULES:
            return _import_module(f".{name}", __name__)
        if name in _HOMES:
            return getattr(_import_module(f".{_HOMES[name]}", __name__), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
