"""The zoo: trained models that are shipped, each with its card, its receipt, its license and the commands that made it.

They come with the package ``stable_worldmodel_zoo``, a wheel of a release, or lie in ``zoo`` of the data folder; nothing is fetched. ``"zoo:NAME"`` is a policy wherever
one is named, and ``"mpc:zoo:NAME"`` plans with the world model of that name.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ._core import core as _swm
from ._requests import log_notes
from .world.ids import explicit
from .world.policies import NativePolicy
from .world.receipts import read_receipt
from .world.results import Receipt

__all__ = ["ZooModel", "list_models", "load"]


class ZooModel(NativePolicy):
    """A model of the zoo as a policy, and what is known of it.

    Args:
        name: Its name.
        seed: Seed of the policy's own noise.
        **settings: Settings of its policy that differ from those that were evaluated.
    """

    def __init__(self, name: str, *, seed: int = 0, **settings: Any) -> None:
        self.name: str = name.removeprefix("zoo:")
        # Its name, environment, success rate with interval, license, size, hash, and the commands that made it.
        self.about: dict[str, Any] = json.loads(_swm.zoo_model(self.name))
        super().__init__(f"zoo:{self.name}", seed=seed, **settings)

    @property
    def env(self) -> str:
        """The id of its environment, for `World`; ``swm_rs/…``, which means the same under `compat`."""
        return explicit(str(self.about["env"]))

    @property
    def folder(self) -> Path:
        """Its folder, which `swm.verify` runs again."""
        return Path(self.about["folder"])

    @property
    def card(self) -> str:
        """Its card."""
        return Path(self.about["card"]).read_text(encoding="utf-8")

    @property
    def receipt(self) -> Receipt:
        """Its evaluation, with the manifest."""
        return read_receipt(self.about["receipt"])

    def __repr__(self) -> str:
        low, high = self.about["ci95"]
        rate = f"{self.about['success_rate']:.1f} % ({low:.1f} to {high:.1f})"
        return f"ZooModel({self.name!r}: {self.about['about']}; {self.about['env']}, {rate}, {self.about['license']})"


def list_models() -> list[dict[str, Any]]:
    """What is known of every model that is installed, by name. One whose files were changed is left out, with a warning."""
    models, notes = _swm.zoo_models()
    log_notes(notes)
    return list(json.loads(models))


def load(name: str, *, seed: int = 0, **settings: Any) -> ZooModel:
    """A model of the zoo, for `World.set_policy`, `swm.evaluate` and whatever else takes a policy.

    Args:
        name: Its name, such as ``"tworoom-gcbc"``.
        seed: Seed of the policy's own noise.
        **settings: Settings of its policy that differ from those that were evaluated, such as ``samples=100``.

    Raises:
        SwmError: There is no model of that name (the message has the nearest), none is installed (how to install them), or a file was changed
            (which).

    Example:
        >>> world.set_policy(swm.zoo.load("tworoom-gcbc"))  # doctest: +SKIP
    """
    return ZooModel(name, seed=seed, **settings)
