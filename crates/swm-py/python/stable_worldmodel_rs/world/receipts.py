"""Evaluations on manifests that others can repeat: receipts, their comparison and their verification."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Literal, overload

from .._access import access_checked
from .._arguments import home_path, path_of, request_text
from .._core import core as _swm
from .._progress import Progress
from .._requests import log_notes
from ..track import Tracker, tracked
from .candidates import compared_by_name, candidate_of, networks_of
from .ids import need
from .manifests import AnyPath, Manifest, existing, read_manifest
from .policies import NativePolicy, as_policy, explains_actions
from .results import Comparison, Receipt, Verification

REFERENCES = ("random", "no_op", "oracle")


@overload
def evaluate(
    manifest: AnyPath | Manifest,
    policy: Any,
    out: AnyPath | None = None,
    *,
    name: str | None = None,
    weights: Sequence[AnyPath] = (),
    policy_seed: int = 0,
    references: Sequence[str] | str = REFERENCES,
    oracle: str | None = None,
    num_envs: int = 8,
    threads: int | None = None,
    plan_steps: int | None = None,
    again: bool = False,
    shard: None = None,
    join: bool = False,
    tracker: Tracker | str | Sequence[str] | None = None,
    progress: bool = True,
    **world: Any,
) -> Receipt: ...
@overload
def evaluate(
    manifest: AnyPath | Manifest,
    policy: Any,
    out: AnyPath,
    *,
    name: str | None = None,
    weights: Sequence[AnyPath] = (),
    policy_seed: int = 0,
    references: Sequence[str] | str = REFERENCES,
    oracle: str | None = None,
    num_envs: int = 8,
    threads: int | None = None,
    plan_steps: int | None = None,
    again: Literal[False] = False,
    shard: tuple[int, int],
    join: Literal[False] = False,
    tracker: None = None,
    progress: bool = True,
    **world: Any,
) -> None: ...
@explains_actions
@access_checked
def evaluate(
    manifest: AnyPath | Manifest,
    policy: Any,
    out: AnyPath | None = None,
    *,
    name: str | None = None,
    weights: Sequence[AnyPath] = (),
    policy_seed: int = 0,
    references: Sequence[str] | str = REFERENCES,
    oracle: str | None = None,
    num_envs: int = 8,
    threads: int | None = None,
    plan_steps: int | None = None,
    again: bool = False,
    shard: tuple[int, int] | None = None,
    join: bool = False,
    tracker: Tracker | str | Sequence[str] | None = None,
    progress: bool = True,
    **world: Any,
) -> Receipt | None:
    """Evaluate a policy on a manifest, beside reference policies on the same pairs.

    An evaluation whose receipt is in ``out`` already is not run again, and another one does not replace it.

    Args:
        manifest: Its file, or what `read_manifest` gave.
        policy: The name of a policy of the core with its arguments, a `NativePolicy`, a function of the infos, or an object
            with ``get_action``.
        out: A folder for ``receipt.json``; there an interrupted evaluation goes on where it stopped, of a policy in Python
            if ``weights`` tell that it is the same.
        name: What a policy in Python is called in the receipt; None: its own description. The receipt has its settings, too:
            what its method ``settings()`` returns, or else the arguments of its constructor, its solver, its cost and its plans.
        weights: Files that a policy in Python depends on: its weights, its code where it has none. The receipt has their
            SHA-256.
        policy_seed: Seed of the policy's own noise, for repetitions on the same pairs.
        references: Which of ``"random"``, ``"no_op"`` and ``"oracle"`` (the same planner on the true dynamics) to run.
        oracle: Another planner for the oracle.
        num_envs: Environments side by side.
        threads: Threads; None: one per core.
        plan_steps: Actions of one plan, for the cost of plans; None: by the settings of the policy, or 25.
        again: Run what ``out`` holds already again, and replace it. A policy in Python without ``weights`` needs it for a
            folder that holds a receipt: its name does not tell whether it is the same policy.
        shard: ``(i, n)``: run part i of n of the episodes, counted from 1, on this machine; there is no receipt.
        join: Make the receipt of all parts that are in ``out``.
        tracker: Where the success rate with its interval and the receipt go, too: what `swm.track.start` gave, or names of trackers, which
            write to ``out``.
        progress: Whether to show a bar for each policy.
        **world: For a Python policy: more arguments of `World`, such as ``image_shape`` or ``image_transform``.

    Returns:
        The receipt, a dict; None for a part. ``swm.compare`` compares several, ``swm.verify`` repeats one.

    Raises:
        SwmError: ``out`` holds the result of another evaluation; or the policy does not fit the environment.
    """
    found = manifest if isinstance(manifest, Manifest) else read_manifest(path_of("the manifest", manifest, "its file, or what read_manifest gave"))
    names = [references] if isinstance(references, str) else list(references)
    check_parts(policy, out, weights, again, shard, join)
    if shard is not None and tracker is not None:
        raise ValueError("tracker= takes whole results; give it with join=True")
    need(found["env"])
    with tracked(tracker, out) as follow:
        text = _evaluated(
            found, policy, out, name, weights, policy_seed, names, oracle, num_envs, threads, plan_steps, again, shard, join, progress, world
        )
        receipt = None if text is None else Receipt(json.loads(text))
        if follow is not None and receipt is not None:
            follow.evaluation(receipt)
    return receipt


def _evaluated(
    found: Manifest,
    policy: Any,
    out: AnyPath | None,
    name: str | None,
    weights: Sequence[AnyPath],
    policy_seed: int,
    names: list[str],
    oracle: str | None,
    num_envs: int,
    threads: int | None,
    plan_steps: int | None,
    again: bool,
    shard: tuple[int, int] | None,
    join: bool,
    progress: bool,
    world: dict[str, Any],
) -> str | None:
    """The receipt as JSON; None for a part."""
    given = candidate_of(
        found, policy, name=name, weights=weights, seed=policy_seed, num_envs=num_envs, threads=threads, world=world
    )
    with Progress("Evaluating", enabled=progress, parts=True) as bar, given as (text, seed, foreign):
        request = {
            "manifest": found,
            "policy": text,
            "policy_seed": seed,
            "reference": names,
            "oracle": oracle,
            "out": home_path("out", out),
            "num_envs": num_envs,
            "threads": threads,
            "plan_steps": plan_steps,
            "again": again,
            "shard": None if shard is None else f"{shard[0]}/{shard[1]}",
            "join": join,
        }
        receipt, notes = _swm.evaluate_manifest(request_text(request, {"reference": "references"}), foreign, bar.begin, bar.tick)
    log_notes(notes)
    return receipt


def check_parts(
    policy: Any,
    out: AnyPath | None,
    weights: Sequence[AnyPath],
    again: bool,
    shard: tuple[int, int] | None,
    join: bool,
) -> None:
    """Refuse parts of an evaluation that could not be joined."""
    if shard is None and not join:
        return
    if shard is not None and join:
        raise ValueError("shard=(i, n) runs a part, join=True makes the result of all; give one of them")
    if out is None:
        raise ValueError("shard and join need out=, the folder of the parts, which all machines see")
    if again:
        raise ValueError("again=True goes with whole runs; remove the folder `parts` in out to run parts again")
    if shard is not None and not 1 <= shard[0] <= shard[1]:
        raise ValueError(f"shard={shard!r}: give (i, n), part i of n, counted from 1")
    if not isinstance(policy, (str, NativePolicy)) and not weights:
        raise ValueError(
            "parts of a policy in Python are joined if they are of the same policy, and its name does not tell; give weights=[…], "
            "the files that it depends on: its weights, its code where it has none"
        )


@access_checked
def read_receipt(path: AnyPath) -> Receipt:
    """Read a receipt, from its file or its folder.

    Raises:
        FileNotFoundError: There is no such file.
    """
    return Receipt(json.loads(_swm.receipt_json(existing(path, "receipt"))))


def _receipt(result: AnyPath | Mapping[str, Any]) -> Receipt:
    if isinstance(result, (str, PathLike)):
        return read_receipt(result)
    return result if isinstance(result, Receipt) else Receipt(result)


@access_checked
def receipt_to_repeat(result: AnyPath | Mapping[str, Any]) -> Receipt:
    """A result as it can be run again: of a bundle, after a comparison of the hashes of its files."""
    if isinstance(result, (str, PathLike)):
        return Receipt(json.loads(_swm.receipt_to_repeat(existing(result, "receipt"))))
    return _receipt(result)


def compare(*results: AnyPath | Receipt | Sequence[AnyPath | Receipt]) -> Comparison:
    """Compare results on the same manifest, pair by pair: is one policy better than another, and what differs?

    Args:
        *results: Receipts, their files or folders. A list of several seeds of one policy is one side.

    Returns:
        A list with one dict per side; ``test`` is the first side against it, ``differs`` in what the evaluation differs from the first
        one (settings, weights, seed, physics), and ``name`` the paths as they were given, of receipts their policies.
    """
    sides: list[tuple[str, list[str]]] = []
    for side in results:
        runs = [side] if isinstance(side, (str, PathLike, Receipt)) else list(side)
        receipts = [_receipt(run) for run in runs]
        names = [str(run["policy"]) if isinstance(run, Receipt) else str(run) for run in runs]
        # Runs of one policy have one name.
        sides.append((",".join(dict.fromkeys(names)) or f"result {len(sides)}", [json.dumps(receipt) for receipt in receipts]))
    return Comparison({"test": None, "differs": [], **side} for side in json.loads(_swm.compare_receipts(sides)))


def same(first: AnyPath | Receipt, other: AnyPath | Receipt) -> bool:
    """Whether two results are equal to the last bit: the same evaluation (policy, settings, weights, manifest, physics), and the same
    outcome of every episode. Wall times and versions of the package may differ. ``Receipt.differences`` names what differs.

    Args:
        first: A receipt, its file or folder.
        other: Another one.
    """
    return not _receipt(first).differences(_receipt(other))


@access_checked
def verify(
    receipt: AnyPath | Receipt,
    policy: Any = None,
    *,
    weights: Sequence[AnyPath] = (),
    oracle: bool = False,
    num_envs: int = 8,
    threads: int | None = None,
    plan_steps: int | None = None,
    progress: bool = True,
    **world: Any,
) -> Verification:
    """Run a receipt's policy and its reference policies again, and say what differs.

    Args:
        receipt: What `evaluate` gave, or its file or folder; or a folder that `bundle` made, whose files are compared with their hashes first.
        policy: For a receipt of a policy in Python, which holds its settings and the hashes of its weights but not its code: that
            policy. Its settings are compared with those of the receipt.
        weights: Where its files are here; None are given: where they were. They are compared by content.
        oracle: Run the oracle again, too, which can take as long as the policy.
        num_envs: Environments side by side.
        threads: Threads; None: one per core.
        plan_steps: Of a policy in Python, if `evaluate` was given it.
        progress: Whether to show a bar over the episodes of all these policies.
        **world: As of `evaluate`.

    Returns:
        A dict: ``equal``, ``differences`` by part (``model``, ``solver``, ``physics``, …), the ``episodes`` that differ, ``checked``, and
        ``not_checked``: what was not compared, and why, such as the weights of a network of which the receipt has no file.
    """
    found = receipt_to_repeat(receipt)
    repeated = sum(oracle or other["role"] != "oracle" for other in found["references"])
    need(found["manifest"]["env"])
    text, own = json.dumps(found), found["candidate"]["policy"]["name"]
    if policy is None and (weights or world):
        raise TypeError("weights and arguments of a World go with a policy in Python; give policy=")
    if isinstance(policy, (str, NativePolicy)):
        raise TypeError(f"policy={policy!r}: the receipt names policies of the core; leave it out")
    with Progress("Verifying", len(found["episodes"]) * (1 + repeated), progress) as bar:
        spread: dict[str, Any] = {"num_envs": num_envs, "threads": threads, "oracle": oracle, "tick": bar.tick}
        if policy is None:
            return _verified(found, json.loads(_swm.verify_receipt(text, **spread)), [])
        given = candidate_of(
            found["manifest"], policy, name=own, weights=weights, seed=0, num_envs=num_envs, threads=threads, world=world
        )
        with given as (name, _, foreign):
            told = json.loads(_swm.verify_receipt(text, (name, foreign), plan_steps, **spread))
        return _verified(found, told, _not_in_a_receipt(found, policy, world))


def _verified(receipt: Mapping[str, Any], told: dict[str, Any], more: list[str]) -> Verification:
    """What the core found, with what was compared and what was not."""
    no_images = receipt["fingerprints"].get("images") is None
    repeated = [str(other["role"]) for other in receipt["references"] if not any("oracle" in note for note in told.get("notes", [])) or other["role"] != "oracle"]
    checked = [f"{len(receipt['episodes'])} episodes of the policy", *(f"those of {role}" for role in repeated), "protocol", "physics", "seed", "solver"]
    checked += [*([] if no_images else ["images"]), *(["model"] if receipt.get("files") else [])]
    skipped = [*told.get("notes", []), *more]
    if no_images:
        skipped.append("images: the evaluation had none")
    if not receipt["references"]:
        skipped.append("reference policies: the evaluation had none; give references= to swm.evaluate")
    return Verification({**told, "checked": checked, "not_checked": skipped})


def _not_in_a_receipt(receipt: Mapping[str, Any], policy: Any, world: Mapping[str, Any]) -> list[str]:
    """What a receipt does not hold of a policy in Python."""
    policy = as_policy(policy)
    skipped: list[str] = []
    if not receipt.get("files"):
        networks = networks_of(policy)
        what = f"the weights of {', '.join(networks)}" if networks else "the code and the files of the policy"
        skipped.append(f"{what}: the receipt has no hash of them; give weights=[…] to swm.evaluate: files of weights, or of code")
    if names := compared_by_name(policy, world):
        skipped.append(f"{', '.join(names)}: compared by name alone, not by what it does")
    return skipped
