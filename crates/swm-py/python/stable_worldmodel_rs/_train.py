"""Training: a request of the core, with a bar, and trackers that follow the run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, TypeAlias, cast

from ._access import access_checked
from ._arguments import home_path, kind_of
from ._requests import asked
from .track import Tracker
from .track._follow import following
from .world.ids import native_env

AnyPath: TypeAlias = str | PathLike[str]


@access_checked
def train(
    baseline: str | None = None,
    dataset: AnyPath | None = None,
    out: AnyPath | None = None,
    *,
    resume: AnyPath | None = None,
    preset: str | None = None,
    settings: Mapping[str, Any] | None = None,
    from_run: AnyPath | None = None,
    encoder: AnyPath | None = None,
    epochs: int | None = None,
    steps: int | None = None,
    batch: int | None = None,
    device: str | None = None,
    precision: str | None = None,
    seed: int | None = None,
    split: float | None = None,
    held_out: float | None = None,
    log_every: int | None = None,
    checkpoint_every: int | None = None,
    keep: int | None = None,
    norm_batches: int | None = None,
    quality_every: int | None = None,
    patience: int | None = None,
    look: Mapping[str, Any] | None = None,
    vary: Sequence[str] | str = (),
    vary_share: float | None = None,
    vary_usual: float | None = None,
    canonical: Mapping[str, Any] | str | None = None,
    env: str | None = None,
    env_options: Mapping[str, Any] | None = None,
    observe: Sequence[str] | str = (),
    max_steps: int | None = None,
    eval_every: int | None = None,
    eval_episodes: int | None = None,
    opening: Mapping[str, Any] | None = None,
    threads: int | None = None,
    tracker: Tracker | str | Sequence[str] | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Train a world model or a policy on a dataset, or an agent in an environment; or go on with a run.

    Without a GPU, take ``preset="small"``. Ctrl-C ends the step at work, and a checkpoint is written; ``resume`` goes on from it with the same
    bits. ``None`` is the default, which ``swm-rs train --help`` lists; ``swm-rs train --list`` lists baselines and presets.

    Args:
        baseline: What is trained: ``"lewm"``, ``"pldm"``, ``"gcsl"``, ``"keypoint-wm"``, ``"sac"``, …
        dataset: The dataset to learn from, as of :func:`data.load_dataset`; with ``resume`` only if it has moved.
        out: The folder of the run; it must hold none.
        resume: The run to go on with, in the place of ``baseline`` and ``out``.
        preset: Such as ``"paper"`` or ``"small"``.
        settings: Settings of the baseline by dotted names, or nested: ``{"optim.lr": 1e-3}``.
        from_run: A run to begin with, also of an import: its model, with its settings and the weights of its last checkpoint.
        encoder: Weights of the encoder: a file, or a run.
        epochs: Epochs over the clips, in each phase.
        steps: Optimizer steps, in each phase; of an agent, steps of the environment.
        batch: Clips per step.
        device: ``"cpu"``; in builds with CUDA also ``"cuda"``.
        precision: ``"fp32"`` or ``"bf16"``.
        seed: Seed of weights, order and noise.
        split: Fraction of episodes to train on; the others validate.
        held_out: Fraction of episodes that is held out from both, as in `make_manifest`.
        log_every: Steps between records of ``metrics.jsonl``.
        checkpoint_every: Steps between validations, each with a checkpoint.
        keep: Checkpoints that are kept beside the best.
        norm_batches: Batches from which statistics of batch normalization are estimated anew.
        quality_every: Steps between measurements of a world model.
        patience: Validations without improvement after which training stops.
        look: Values of visual factors, such as ``{"background.color": "black"}``, with which a recording of this package is rendered.
        vary: Visual factors to sample for every clip.
        vary_share: Probability of each of them to be sampled for a clip.
        vary_usual: Probability of a clip to show none of them sampled.
        canonical: The look that `canonical` learns to draw, as ``look``, or ``"recorded"``.
        env: The environment that an agent learns in.
        env_options: Its settings.
        observe: Columns that an agent observes.
        max_steps: Steps after which an episode of an agent is truncated.
        eval_every: Steps between evaluations of an agent.
        eval_episodes: Episodes of each.
        opening: How a dataset of another program is opened: ``camera``, ``map`` and so on, as ``options`` of ``NativeDataset``.
        threads: Threads; None: one per core.
        tracker: Where the lines of ``metrics.jsonl`` go, too, as they come: what `swm.track.start` gave, or names of trackers. The run has event
            files for TensorBoard in any case.
        progress: Whether to show a bar.

    Returns:
        Where training ended: ``run`` (the folder), ``step``, ``end``, ``train``, ``validation`` and, of an agent, ``evaluation`` (values by name),
        ``best`` (its step and value). ``mpc:RUN`` plans with a world model, ``policy:RUN`` acts as a policy.

    Raises:
        FileNotFoundError: There is no such dataset.
        ImportError: The library of a tracker is not installed; the message has how to install it.
        SwmError: A setting is wrong, the dataset lacks what the model needs, or a loss is not finite; the message names it.

    Example:
        >>> swm.train("pldm", "pusht.h5", "runs/pldm", preset="small", epochs=1)["run"]  # doctest: +SKIP
        'runs/pldm'
    """
    from .data._paths import recorded

    if settings is not None and not isinstance(cast("Any", settings), Mapping):
        raise TypeError(f'settings is {kind_of(settings)}; give a dict of names and values: {{"optim.lr": 1e-3}}')
    native, options = (None, env_options) if env is None else native_env(env, env_options or {})
    request: dict[str, Any] = {
        "baseline": baseline,
        "dataset": None if dataset is None else recorded("dataset", dataset),
        "opening": opening,
        "out": home_path("out", out),
        "resume": home_path("resume", resume),
        "preset": preset,
        "set": dict(_flat(settings or {})),
        "from_run": home_path("from_run", from_run),
        "encoder": home_path("encoder", encoder),
        "epochs": epochs,
        "steps": steps,
        "batch": batch,
        "device": None if device is None else str(device),
        "precision": precision,
        "seed": seed,
        "split": split,
        "held_out": held_out,
        "log_every": log_every,
        "checkpoint_every": checkpoint_every,
        "keep": keep,
        "norm_batches": norm_batches,
        "quality_every": quality_every,
        "patience": patience,
        "look": look,
        "vary": _names(vary),
        "vary_share": vary_share,
        "vary_usual": vary_usual,
        "canonical": {} if canonical == "recorded" else canonical,
        "env": native or env,
        "env_option": options or env_options,
        "observe": _names(observe),
        "max_steps": max_steps,
        "eval_every": eval_every,
        "eval_episodes": eval_episodes,
        "threads": threads,
    }
    run = request["resume"] or request["out"]
    with following(None if run is None else tracker, run or "") as follower:
        state = asked("train", request, progress, None if follower is None else follower.poll)
    for part in ("train", "validation", "evaluation"):
        if part in state:
            state[part] = dict(state[part])
    return {"run": run, **{name: state[name] for name in _KEPT if name in state}}


# What a caller learns of how far training is; the rest is for going on with it.
_KEPT = ("step", "end", "train", "validation", "evaluation", "best", "episodes")


def _names(names: Sequence[str] | str) -> list[str]:
    """Names, also of one text with commas."""
    return [name for name in names.split(",") if name] if isinstance(names, str) else list(names)


def _flat(settings: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings by dotted names."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(cast("Mapping[str, Any]", value), f"{before}{name}.")
        else:
            yield f"{before}{name}", value
