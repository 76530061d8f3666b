"""Ids of environments: which of them are this package's own."""

from __future__ import annotations

from functools import cache

from .._core import core as _swm
from .._files import offer_metaworld, offer_ogbench

# Ids under which the reference has what this package numbers otherwise.
RENAMED = {"swm/TwoRoom-v1": "swm/TwoRoom-v2"}
_OURS = "swm_rs/"


@cache
def aliases() -> dict[str, str]:
    """Further spellings of ids, and the ids."""
    return dict(_swm.env_aliases())


@cache
def env_ids() -> tuple[str, ...]:
    """The ids of all environments of this package."""
    return tuple(name for name, _ in _swm.env_ids())


def native_id(env_name: str) -> str | None:
    """The id in this package of the environment that ``env_name`` means; None for those of others.

    ``swm/…`` means what the reference calls so (its ``TwoRoom-v1`` is our ``TwoRoom-v2``), ``swm_rs/…`` this package's
    own numbering.
    """
    if env_name.startswith(_OURS):
        name = "swm/" + env_name[len(_OURS) :]
        name = aliases().get(name, name)
    else:
        name = RENAMED.get(env_name, aliases().get(env_name, env_name))
        if name not in env_ids():
            return None
    need(name)
    return name


def need(env: str) -> None:
    """Make the files of an environment known that is about to be made; ``env`` is an id of this package's own numbering."""
    if env.startswith("swm/OGB"):
        offer_ogbench()
    if env.startswith("swm/MetaWorld"):
        offer_metaworld()
