"""Evaluations that others can repeat: manifests, receipts, comparisons, replays."""

from __future__ import annotations

import json
import logging
import operator
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .._core import core as _swm
from .native import checked_shape
from .policies import NativePolicy, describe
from .progress import Progress
from .results import html_table
from .world import World

AnyPath = str | PathLike[str]
REFERENCES = ("random", "no_op", "oracle")
logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")


class Manifest(dict[str, Any]):
    """A fixed list of starts and goals with a budget and a rule of success: what is evaluated. ``hash`` names it."""

    def __init__(self, data: Mapping[str, Any], hash: str) -> None:
        super().__init__(data)
        self.hash = hash

    def __repr__(self) -> str:
        return f"Manifest({self['env']}, {self['tier']} tier, {len(self['pairs'])} pairs, {self.hash[:12]})"


class Receipt(dict[str, Any]):
    """What a policy came to on a manifest, and all it takes to repeat it: the JSON of ``receipt.json``."""

    @property
    def success_rate(self) -> float:
        """In percent."""
        return float(self["summary"]["success_rate"])

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the success rate, in percent."""
        low, high = self["summary"]["ci95"]
        return float(low), float(high)

    @property
    def episode_successes(self) -> npt.NDArray[np.bool_]:
        """Of every pair, bool ``(E,)``."""
        return np.array([episode["success"] for episode in self["episodes"]], dtype=bool)

    def rows(self) -> list[tuple[str, str]]:
        """The table that people read."""
        rows = [(str(self["policy"]), _rate(self["summary"]))]
        for other in self["references"]:
            low, high = other["test"]["interval95"]
            difference = f"difference {other['test']['difference']:+.1f} ({low:+.1f} to {high:+.1f})"
            rows.append((str(other["role"]), f"{_rate(other['summary'])}, {difference}"))
        at_reset = self["summary"]["solved_at_start"]
        rows.append(("pairs", f"{len(self['episodes'])}, {at_reset} with success at reset, which count for every policy"))
        return rows

    def __repr__(self) -> str:
        return f"Receipt({self['manifest']['env']}, " + ", ".join(f"{name}: {rate}" for name, rate in self.rows()) + ")"

    def _repr_html_(self) -> str:
        return html_table(self.rows())


class Comparison(list[dict[str, Any]]):
    """Sides of a comparison: ``name``, ``policy``, ``runs``, ``success_rate``, ``ci95``, ``std`` (between seeds), and ``test``:
    the first side against this one, pair by pair (``difference``, ``interval95``, ``p_value``)."""

    def _repr_html_(self) -> str:
        def test(side: Mapping[str, Any]) -> str:
            if side["test"] is None:
                return ""
            low, high = side["test"]["interval95"]
            difference = side["test"]["difference"]
            return f", first − this {difference:+.1f} ({low:+.1f} to {high:+.1f}), p = {side['test']['p_value']:.4f}"

        return html_table([(str(side["policy"]), f"{_rate(side)}{test(side)}") for side in self])


def read_manifest(path: AnyPath) -> Manifest:
    """Read a manifest (TOML or JSON). One that was changed after it was written is refused.

    Raises:
        FileNotFoundError: There is no such file.
        SwmError: It is no manifest, or was changed.
    """
    text, hash = _swm.manifest_json(_existing(path, "manifest"))
    return Manifest(json.loads(text), hash)


def _chosen(pair: str | tuple[int, int, int]) -> str:
    """A chosen pair as text: ``EPISODE:START-GOAL``."""
    if isinstance(pair, str):
        return pair
    if len(pair) != 3:
        raise ValueError(f"a pair is (episode, start, goal) or a text such as '3:10-35', found {pair!r}")
    episode, start, goal = map(int, pair)
    return f"{episode}:{start}-{goal}"


def _plain(value: Any) -> Any:
    """Arrays and numbers of NumPy, and what else counts as an integer, as JSON has them."""
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else operator.index(value)


def make_manifest(
    path: AnyPath,
    env_name: str,
    episodes: int = 100,
    *,
    tier: str = "historic",
    seed: int = 42,
    budget: int | None = None,
    dataset: AnyPath | None = None,
    goal_offset: int = 25,
    held_out: float = 0.2,
    pairs: Sequence[str | tuple[int, int, int]] | None = None,
    frame_skip: int | None = None,
    image_shape: tuple[int, int] | None = None,
    distractors: Sequence[str] = (),
    variation: Sequence[str] | None = None,
    variation_values: Mapping[str, Any] | None = None,
    overwrite: bool = False,
    **settings: Any,
) -> Manifest:
    """Choose starts and goals, and write them into a file.

    A file that holds another manifest is not replaced, as results refer to it.

    Args:
        path: ``….toml`` or ``….json``.
        env_name: An environment of this package.
        episodes: Pairs of start and goal.
        tier: ``"historic"`` (as published), ``"moderate"`` (held-out episodes, no success at reset, starts at rest) or
            ``"strict"`` (more motion, a tighter rule).
        seed: Of the choice.
        budget: Actions allowed; None: 200, or 50 from a dataset.
        dataset: Take starts and goals from its rows, the goal ``goal_offset`` rows after the start.
        held_out: Share of its episodes that is held out from training.
        pairs: These steps of ``dataset`` as starts and goals, in place of ``episodes``, ``goal_offset`` and ``held_out``:
            (episode, start, goal), counted from 0, or ``"3:10-35"``, or ``"3:10-4:0"`` for a goal in another episode.
        frame_skip: How often each action is applied; None: 1, or as recorded.
        image_shape: (height, width) of the images that policies see.
        distractors: What changes those images.
        variation: Factors to sample; ``"+NAME"`` in addition to the default ones. ``variation_values``: factors to set, by
            numbers, or by the names of colors and choices.
        overwrite: Replace a file that holds something else.
        **settings: Of the environment.

    Raises:
        SwmError: The file exists and is not this manifest; or the environment, a factor or the dataset does not fit.
    """
    from .ids import native_id

    shape = checked_shape(image_shape)
    request = {
        "env": native_id(env_name) or env_name,
        "env_option": settings,
        "tier": tier,
        "out": str(path),
        "episodes": episodes,
        "seed": seed,
        "dataset": None if dataset is None else str(_existing(dataset, "dataset")),
        "pairs": None if pairs is None else [_chosen(pair) for pair in pairs],
        "goal_offset": goal_offset,
        "held_out": held_out,
        "budget": budget,
        "frame_skip": frame_skip,
        "image_size": None if shape is None else {"height": shape[0], "width": shape[1]},
        "distractor": list(distractors),
        "vary": None if variation is None else list(variation),
        "set": dict(variation_values or {}),
        "overwrite": overwrite,
    }
    text, hash, notes = _swm.make_manifest(json.dumps(request, default=_plain, allow_nan=False))
    for note in notes:
        logger.warning("%s", note)
    return Manifest(json.loads(text), hash)


def evaluate(
    manifest: AnyPath | Manifest,
    policy: Any,
    out: AnyPath | None = None,
    *,
    policy_seed: int = 0,
    references: Sequence[str] | str = REFERENCES,
    oracle: str | None = None,
    num_envs: int = 16,
    threads: int | None = None,
    plan_steps: int | None = None,
    again: bool = False,
    progress: bool = True,
    **world: Any,
) -> Receipt:
    """Evaluate a policy on a manifest, beside reference policies on the same pairs.

    An evaluation whose receipt is in ``out`` already is not run again, and another one does not replace it.

    Args:
        manifest: Its file, or what `read_manifest` gave.
        policy: The name of a policy of the core with its arguments, a `NativePolicy`, a function of the infos, or an object
            with ``get_action``.
        out: A folder for ``receipt.json``; there an interrupted evaluation goes on where it stopped.
        policy_seed: Seed of the policy's own noise, for repetitions on the same pairs.
        references: Which of ``"random"``, ``"no_op"`` and ``"oracle"`` (the same planner on the true dynamics) to run.
        oracle: Another planner for the oracle.
        num_envs: Environments side by side.
        threads: Threads; None: one per core.
        plan_steps: Actions of one plan of a Python policy, for the cost of its plans; default 25.
        again: Run what ``out`` holds already again, and replace it. A policy in Python needs it for a folder that holds a
            receipt: its name does not tell whether it is the same policy.
        progress: Whether to show a bar for each policy.
        **world: For a Python policy: more arguments of `World`, such as ``image_shape`` or ``image_transform``.

    Returns:
        The receipt, a dict. ``swm.compare`` compares several, ``swm.verify`` repeats one.

    Raises:
        SwmError: ``out`` holds the result of another evaluation; or the policy does not fit the environment.
    """
    found = manifest if isinstance(manifest, Manifest) else read_manifest(manifest)
    names = [references] if isinstance(references, str) else list(references)
    if isinstance(policy, NativePolicy):
        policy, policy_seed = policy.text, policy_seed or policy.seed
    with Progress("Evaluating", len(found["pairs"]), progress, parts=True) as bar:
        common: dict[str, Any] = {
            "policy_seed": policy_seed,
            "references": names,
            "oracle": oracle,
            "out": None if out is None else str(out),
            "num_envs": num_envs,
            "threads": threads,
            "plan_steps": plan_steps,
            "again": again,
            "begin": bar.begin,
            "tick": bar.tick,
        }
        text = json.dumps(found)
        if isinstance(policy, str):
            result, is_done = _swm.evaluate_manifest(text, policy, None, **common)
            if is_done:
                logger.warning("%s: already done; again=True repeats it", Path(str(out)) / "receipt.json")
            return Receipt(json.loads(result))
        with _world_for(found, min(num_envs, len(found["pairs"])), threads, world) as live:
            live.set_policy(policy)
            act = live._driver(None)  # pyright: ignore[reportPrivateUsage]
            foreign = (live._native(), act)  # pyright: ignore[reportPrivateUsage]
            return Receipt(json.loads(_swm.evaluate_manifest(text, describe(live.policy), foreign, **common)[0]))


def _world_for(manifest: Manifest, num_envs: int, threads: int | None, given: Mapping[str, Any]) -> World:
    image = manifest.get("image")
    shape = given.get("image_shape", None if image is None else (image["height"], image["width"]))
    options: dict[str, Any] = {
        "max_episode_steps": manifest["budget"],
        "frame_skip": manifest["frame_skip"],
        "distractors": manifest.get("distractors", ()),
        "threads": threads,
        "image_shape": shape,
        "add_pixels": shape is not None,
        **manifest.get("settings", {}),
        **{name: value for name, value in given.items() if name != "image_shape"},
    }
    # The manifest names environments as this package numbers them.
    return World("swm_rs/" + manifest["env"].removeprefix("swm/"), num_envs, **options)


def read_receipt(path: AnyPath) -> Receipt:
    """Read a receipt, from its file or its folder.

    Raises:
        FileNotFoundError: There is no such file.
    """
    return Receipt(json.loads(_swm.receipt_json(_existing(path, "receipt"))))


def compare(*results: AnyPath | Receipt | Sequence[AnyPath | Receipt]) -> Comparison:
    """Compare results on the same manifest, pair by pair: is one policy better than another?

    Args:
        *results: Receipts, their files or folders. A list of several seeds of one policy is one side.

    Returns:
        A list with one dict per side; ``test`` is the first side against it, and ``name`` the paths as they were given, of receipts
        their policies.
    """
    sides: list[tuple[str, list[str]]] = []
    for side in results:
        runs = [side] if isinstance(side, (str, PathLike, Receipt)) else list(side)
        receipts = [run if isinstance(run, Receipt) else read_receipt(run) for run in runs]
        names = [str(run["policy"]) if isinstance(run, Receipt) else str(run) for run in runs]
        # Runs of one policy have one name.
        sides.append((",".join(dict.fromkeys(names)) or f"result {len(sides)}", [json.dumps(receipt) for receipt in receipts]))
    return Comparison({"test": None, **side} for side in json.loads(_swm.compare_receipts(sides)))


def verify(
    receipt: AnyPath | Receipt,
    *,
    oracle: bool = False,
    num_envs: int = 16,
    threads: int | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Run a receipt's policy of the core and its reference policies again, and say what differs.

    Args:
        receipt: What `evaluate` gave, or its file or folder.
        oracle: Run the oracle again, too, which can take as long as the policy.
        num_envs: Environments side by side.
        threads: Threads; None: one per core.
        progress: Whether to show a bar over the episodes of all these policies.
    """
    found = receipt if isinstance(receipt, Receipt) else read_receipt(receipt)
    repeated = sum(oracle or other["role"] != "oracle" for other in found["references"])
    with Progress("Verifying", len(found["episodes"]) * (1 + repeated), progress) as bar:
        return dict(json.loads(_swm.verify_receipt(json.dumps(found), num_envs, threads, oracle, bar.tick)))


def replay(
    path: AnyPath,
    episodes: Sequence[int] | None = None,
    *,
    variation_values: Mapping[str, Any] | None = None,
    tolerance: float = 0.0,
    env_name: str | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Repeat recorded episodes on the simulator: is the dataset what it says it is?

    Args:
        path: A dataset file.
        episodes: Which; None: all.
        variation_values: Factors to set in place of recorded ones.
        tolerance: Largest accepted difference.
        env_name: The environment, where the file does not say.
        progress: Whether to show a bar.

    Returns:
        ``ok``, ``episodes``, ``rows``, and the largest differences by column.
    """
    total = 0 if episodes is None else len(episodes)
    values = None if variation_values is None else dict(variation_values)
    with Progress("Replaying", total, progress) as bar:
        chosen = None if episodes is None else [int(episode) for episode in episodes]
        text = _swm.replay(_existing(path, "dataset"), chosen, values, tolerance, env_name, bar.tick)
    return dict(json.loads(text))


def _existing(path: AnyPath, what: str) -> str:
    found = Path(path).expanduser()
    if not found.exists():
        raise FileNotFoundError(f"there is no {what} {found}")
    return str(found)


def _rate(summary: Mapping[str, Any]) -> str:
    low, high = summary["ci95"]
    return f"{summary['success_rate']:.1f} % ({low:.1f} to {high:.1f})"
