"""World-model research in Python over a Rust core: environments, datasets, planning, evaluation.

Names are loaded when they are first used, so that `import stable_worldmodel_rs` is quick and needs no torch.
"""

import logging as _logging
from importlib import import_module as _import_module
from typing import TYPE_CHECKING

from . import _files, _gym
from ._swm import __version__

if TYPE_CHECKING:
    # What type checkers and editors see of the names below.
    from . import buffer, compat, data, envs, hub, planning, policy, protocols, spaces, track, vector, wm, world, zoo
    from ._swm import DataError, EnvError, PlanError, PolicyError, SwmError
    from ._access import FilePermissionError
    from ._train import train
    from .buffer import HistoryBuffer
    from .planning.mpc import MpcPolicy
    from .policy import BasePolicy, ExpertPolicy, FeedForwardPolicy, PlanConfig, Policy, RandomPolicy, WorldModelPolicy
    from .wm.utils import download_model, load_pretrained, save_pretrained
    from .world.bundles import board, bundle
    from .world.dataset_runs import evaluate_from_dataset
    from .world.env_pool import EnvPool
    from .world.manifests import Manifest, make_manifest, read_manifest
    from .world.policies import NativePolicy
    from .world.receipts import compare, evaluate, read_receipt, same, verify
    from .world.requests import bench, measure, plan, render, replay
    from .world.reproductions import recipes, reproduce
    from .world.results import Comparison, EvaluationResult, Receipt, Sweep, Verification
    from .world.sweeps import read_sweep, sweep
    from .world.world import World

__all__ = [
    "BasePolicy",
    "Comparison",
    "DataError",
    "EnvError",
    "EnvPool",
    "EvaluationResult",
    "ExpertPolicy",
    "FeedForwardPolicy",
    "FilePermissionError",
    "HistoryBuffer",
    "Manifest",
    "MpcPolicy",
    "NativePolicy",
    "PlanConfig",
    "PlanError",
    "Policy",
    "PolicyError",
    "RandomPolicy",
    "Receipt",
    "Sweep",
    "SwmError",
    "Verification",
    "World",
    "WorldModelPolicy",
    "__version__",
    "bench",
    "board",
    "buffer",
    "bundle",
    "compare",
    "compat",
    "data",
    "download_model",
    "envs",
    "evaluate",
    "evaluate_from_dataset",
    "hub",
    "load_pretrained",
    "make_manifest",
    "measure",
    "plan",
    "planning",
    "policy",
    "protocols",
    "read_manifest",
    "read_receipt",
    "read_sweep",
    "recipes",
    "render",
    "replay",
    "reproduce",
    "same",
    "save_pretrained",
    "spaces",
    "sweep",
    "track",
    "train",
    "vector",
    "verify",
    "wm",
    "world",
    "zoo",
]

# Public name -> the module that defines it.
_HOMES: dict[str, str] = {
    "SwmError": "_swm",
    "EnvError": "_swm",
    "PolicyError": "_swm",
    "DataError": "_swm",
    "PlanError": "_swm",
    "World": "world.world",
    "NativePolicy": "world.policies",
    "EvaluationResult": "world.results",
    "EnvPool": "world.env_pool",
    "FilePermissionError": "_access",
    "evaluate_from_dataset": "world.dataset_runs",
    "board": "world.bundles",
    "bundle": "world.bundles",
    "Manifest": "world.manifests",
    "make_manifest": "world.manifests",
    "read_manifest": "world.manifests",
    "compare": "world.receipts",
    "evaluate": "world.receipts",
    "read_receipt": "world.receipts",
    "same": "world.receipts",
    "verify": "world.receipts",
    "bench": "world.requests",
    "measure": "world.requests",
    "plan": "world.requests",
    "render": "world.requests",
    "replay": "world.requests",
    "recipes": "world.reproductions",
    "reproduce": "world.reproductions",
    "Comparison": "world.results",
    "Receipt": "world.results",
    "Sweep": "world.results",
    "Verification": "world.results",
    "read_sweep": "world.sweeps",
    "sweep": "world.sweeps",
    "train": "_train",
    "PlanConfig": "policy",
    "WorldModelPolicy": "policy",
    "FeedForwardPolicy": "policy",
    "RandomPolicy": "policy",
    "BasePolicy": "policy",
    "ExpertPolicy": "policy",
    "Policy": "policy",
    "HistoryBuffer": "buffer",
    "MpcPolicy": "planning.mpc",
    "download_model": "wm.utils",
    "load_pretrained": "wm.utils",
    "save_pretrained": "wm.utils",
}
_MODULES = frozenset(
    {"buffer", "compat", "data", "envs", "hub", "planning", "policy", "protocols", "spaces", "track", "vector", "wm", "world", "zoo"}
)

# Without a handler of the program, Python would write warnings to stderr.
_logging.getLogger(__name__).addHandler(_logging.NullHandler())
_files.choose()
_gym.register_when_imported()


if not TYPE_CHECKING:
    # Type checkers would take any name for granted.
    def __getattr__(name: str) -> object:
        if name in _MODULES:
            return _import_module(f".{name}", __name__)
        if name in _HOMES:
            value = getattr(_import_module(f".{_HOMES[name]}", __name__), name)
            globals()[name] = value
            return value
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
