"""Sweeps: does a policy generalize to changed factors of variation?"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Literal, overload

from .._access import access_checked
from .._arguments import home_path, request_text
from .._core import core as _swm
from .._progress import Progress
from .._requests import log_notes
from .candidates import candidate_of
from .ids import need
from .manifests import AnyPath, Manifest, existing, read_manifest
from .receipts import check_parts
from .results import Sweep


@overload
def sweep(
    manifest: AnyPath | Manifest,
    policy: Any,
    factors: Sequence[str] | str = "all",
    out: AnyPath | None = None,
    *,
    values: str = "sampled",
    points: int | None = None,
    name: str | None = None,
    weights: Sequence[AnyPath] = (),
    policy_seed: int = 0,
    num_envs: int = 8,
    threads: int | None = None,
    plan_steps: int | None = None,
    again: bool = False,
    shard: None = None,
    join: bool = False,
    progress: bool = True,
    **world: Any,
) -> Sweep: ...
@overload
def sweep(
    manifest: AnyPath | Manifest,
    policy: Any,
    factors: Sequence[str] | str = "all",
    *,
    out: AnyPath,
    values: str = "sampled",
    points: int | None = None,
    name: str | None = None,
    weights: Sequence[AnyPath] = (),
    policy_seed: int = 0,
    num_envs: int = 8,
    threads: int | None = None,
    plan_steps: int | None = None,
    again: Literal[False] = False,
    shard: tuple[int, int],
    join: Literal[False] = False,
    progress: bool = True,
    **world: Any,
) -> None: ...
@access_checked
def sweep(
    manifest: AnyPath | Manifest,
    policy: Any,
    factors: Sequence[str] | str = "all",
    out: AnyPath | None = None,
    *,
    values: str = "sampled",
    points: int | None = None,
    name: str | None = None,
    weights: Sequence[AnyPath] = (),
    policy_seed: int = 0,
    num_envs: int = 8,
    threads: int | None = None,
    plan_steps: int | None = None,
    again: bool = False,
    shard: tuple[int, int] | None = None,
    join: bool = False,
    progress: bool = True,
    **world: Any,
) -> Sweep | None:
    """Evaluate a policy under factors of variation, on the pairs of a manifest: once per factor, per group whose factors are all named,
    and per ``"a+b"``; ``"all"`` adds one evaluation with every factor. Each is compared with the unchanged environment. The same as
    ``swm-rs sweep``, for policies in Python, too.

    Args:
        manifest: Its file, or what `read_manifest` gave.
        policy: As of `evaluate`.
        factors: Names of factors or groups, or ``"all"``; ``"a+b"`` changes several together.
        out: A folder for ``sweep.json``, ``sweep.csv`` and ``sweep.svg``; there an interrupted sweep goes on where it stopped, of a
            policy in Python if ``weights`` tell that it is the same.
        values: ``"sampled"`` for every episode, ``"extremes"`` (the smallest, then the largest), or ``"grid"``.
        points: Values of a grid; None: 5, or every value where the factors are choices of up to 16.
        name, weights, policy_seed, num_envs, threads, again, shard, join: As of `evaluate`.
        plan_steps: As of `evaluate`, for a policy in Python.
        progress: Whether to show a bar over the evaluations.
        **world: As of `evaluate`.

    Returns:
        The sweep, a dict; None for a part.

    Raises:
        SwmError: ``out`` holds another sweep, a factor is unknown, or the policy does not fit the environment.
    """
    found = manifest if isinstance(manifest, Manifest) else read_manifest(manifest)
    asked = factors.split(",") if isinstance(factors, str) else list(factors)
    check_parts(policy, out, weights, again, shard, join)
    need(found["env"])
    given = candidate_of(
        found, policy, name=name, weights=weights, seed=policy_seed, num_envs=num_envs, threads=threads, world=world
    )
    with Progress("Sweeping", enabled=progress, parts=True) as bar, given as (text, seed, foreign):
        if foreign is None and plan_steps is not None:
            raise TypeError("plan_steps: for policies in Python; a policy of the core has its own")
        request = {
            "manifest": found,
            "policy": text,
            "policy_seed": seed,
            "plan_steps": plan_steps,
            "factors": [name.strip() for name in asked],
            "values": values,
            "points": points,
            "out": home_path("out", out),
            "num_envs": num_envs,
            "threads": threads,
            "again": again,
            "shard": None if shard is None else f"{shard[0]}/{shard[1]}",
            "join": join,
        }
        swept, notes = _swm.sweep_manifest(request_text(request), foreign, bar.begin, bar.tick)
    log_notes(notes)
    return None if swept is None else Sweep(json.loads(swept))


@access_checked
def read_sweep(path: AnyPath) -> Sweep:
    """Read a sweep, from its file or its folder.

    Raises:
        FileNotFoundError: There is no such file.
    """
    return Sweep(json.loads(_swm.sweep_json(existing(path, "sweep"))))
