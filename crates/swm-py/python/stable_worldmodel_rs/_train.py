"""Training: the command ``swm-rs train`` in a process of its own, with its progress, its notes and its errors here."""

from __future__ import annotations

import json
import logging
import os
import queue
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from threading import Thread
from typing import Any, TypeAlias, cast

from ._core import core as _swm
from .track import Tracker
from .track._follow import Follower, following
from .world.ids import native_id
from .world.progress import Progress

AnyPath: TypeAlias = str | PathLike[str]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")
# How often progress is looked at, and how long an interrupted training may take to write a checkpoint.
_PERIOD_S, _SAVING_S = 0.05, 30.0
# Settings that are called otherwise here than in the command.
_NAMES = {"set": "settings", "env-option": "env_options"}
_PROGRESS = re.compile(r"(\d+) of (\d+)(?: \([^)]*\))?: ")


def train(
    baseline: str | None = None,
    dataset: AnyPath | None = None,
    out: AnyPath | None = None,
    *,
    resume: AnyPath | None = None,
    preset: str | None = None,
    settings: Mapping[str, Any] | None = None,
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
    threads: int | None = None,
    tracker: Tracker | str | Sequence[str] | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Train a world model or a policy on a dataset, or an agent in an environment; or go on with a run.

    Without a GPU, take ``preset="small"``. Ctrl-C ends the step at work, and a checkpoint is written; ``resume`` goes on from it with the same
    bits. What is ``None`` is as the command has it: ``swm-rs train --help`` lists defaults, ``swm-rs train --list`` baselines and presets.

    Args:
        baseline: What is trained: ``"lewm"``, ``"pldm"``, ``"gcsl"``, ``"keypoint-wm"``, ``"sac"``, …
        dataset: The dataset to learn from; with ``resume`` only if it has moved.
        out: The folder of the run; it must hold none.
        resume: The run to go on with, in the place of ``baseline`` and ``out``.
        preset: Such as ``"paper"`` or ``"small"``.
        settings: Settings of the baseline by dotted names, or nested: ``{"optim.lr": 1e-3}``.
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
        threads: Threads; None: one per core.
        tracker: Where the lines of ``metrics.jsonl`` go, too, as they come: what `swm.track.start` gave, or names of trackers. The run has event
            files for TensorBoard in any case.
        progress: Whether to show a bar.

    Returns:
        Where training ended: ``run`` (the folder), ``step``, ``end``, ``train``, ``validation`` and, of an agent, ``evaluation`` (values by name),
        ``best`` (its step and value). ``mpc:RUN`` plans with a world model, ``policy:RUN`` acts as a policy.

    Raises:
        ImportError: The library of a tracker is not installed; the message has how to install it.
        SwmError: A setting is wrong, the dataset lacks what the model needs, or a loss is not finite; the message names it.

    Example:
        >>> swm.train("pldm", "pusht.h5", "runs/pldm", preset="small", epochs=1)["run"]  # doctest: +SKIP
        'runs/pldm'
    """
    request = {
        "baseline": baseline,
        "dataset": _path(dataset),
        "out": _path(out),
        "resume": _path(resume),
        "preset": preset,
        "set": dict(_flat(settings or {})),
        "encoder": _path(encoder),
        "epochs": epochs,
        "steps": steps,
        "batch": batch,
        "device": device,
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
        "look": _factors(look or {}),
        "vary": vary if isinstance(vary, str) else ",".join(vary),
        "vary_share": vary_share,
        "vary_usual": vary_usual,
        "canonical": canonical if isinstance(canonical, str) else _factors(canonical or {}),
        "env": None if env is None else native_id(env) or env,
        "env_option": dict(env_options or {}),
        "observe": observe if isinstance(observe, str) else ",".join(observe),
        "max_steps": max_steps,
        "eval_every": eval_every,
        "eval_episodes": eval_episodes,
        "threads": threads,
    }
    run = _path(resume) or _path(out)
    if run is None:
        raise _swm.SwmError("out=: name the folder of the new run, or give resume= to go on with one")
    with Progress("Training", 0, progress, parts=True, unit="steps") as bar:
        with following(tracker, run) as follower:
            state = _train(request, run, bar, follower)
    for part in ("train", "validation", "evaluation"):
        if part in state:
            state[part] = dict(state[part])
    return {"run": run, **{name: state[name] for name in _KEPT if name in state}}


# What a caller learns of how far training is; the rest is for going on with it.
_KEPT = ("step", "end", "train", "validation", "evaluation", "best", "episodes")


def _train(request: Mapping[str, Any], run: str, bar: Progress, follower: Follower | None) -> dict[str, Any]:
    """Run the command and give the state that it prints."""
    if not sys.executable:
        raise _swm.SwmError("training runs in a process of its own, and this Python does not know its program; set sys.executable")
    safe = ["-P"] if sys.version_info >= (3, 11) else []
    command = [sys.executable, *safe, "-m", "stable_worldmodel_rs", "--json", "train", *words(request)]
    with tempfile.TemporaryFile() as result:
        # In a session of its own, so that Ctrl-C reaches it once, from here.
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=result, stderr=subprocess.PIPE, start_new_session=True
        )
        said = _watch(child, Path(run).name, bar, follower)
        if child.returncode:
            raise _swm.SwmError(_reason(child.returncode, said))
        result.seek(0)
        return dict(json.loads(result.read()))


def words(request: Mapping[str, Any]) -> list[str]:
    """The settings of a request as words of the command; those that were not given are left out."""
    found = [] if request.get("baseline") is None else [f"{request['baseline']}"]
    for name, value in request.items():
        if name == "baseline" or value is None or value == "" or value == {}:
            continue
        option = "--" + name.replace("_", "-")
        pairs: list[tuple[str | None, Any]] = list(cast("Mapping[str, Any]", value).items()) if isinstance(value, Mapping) else [(None, value)]
        for key, one in pairs:
            found.append(f"{option}={_text(one)}" if key is None else f"{option}={key}={_text(one)}")
    return found


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value.item() if hasattr(value, "item") else value)


def _flat(settings: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings by dotted names."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(cast("Mapping[str, Any]", value), f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _factors(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of factors as the command takes them: numbers of one with commas."""
    listed = {name: cast("Sequence[Any]", value) for name, value in values.items() if isinstance(value, (list, tuple))}
    return {**values, **{name: ",".join(map(_text, value)) for name, value in listed.items()}}


def _path(path: AnyPath | None) -> str | None:
    return None if path is None else str(Path(path).expanduser())


def _watch(child: subprocess.Popen[bytes], name: str, bar: Progress, follower: Follower | None) -> list[str]:
    """Wait for the command, show how far it is, and give what it said beside that."""
    lines: queue.Queue[str] = queue.Queue()
    reader = Thread(target=_read, args=(child.stderr, lines), name="swm-train", daemon=True)
    reader.start()
    said: list[str] = []
    shown = 0
    try:
        while reader.is_alive() or not lines.empty():
            try:
                line = lines.get(timeout=_PERIOD_S)
            except queue.Empty:
                if follower is not None:
                    follower.poll()
                continue
            step = _PROGRESS.match(line)
            if step is None:
                said.append(line)
                continue
            logger.debug("%s", line)
            done, total = int(step[1]), int(step[2])
            if shown != total:
                bar.begin(name, total)
                shown = total
            bar.tick(done, 0, 0)
        child.wait()
    except BaseException:
        _stop(child)
        raise
    finally:
        if child.stderr is not None:
            child.stderr.close()
    for line in said if child.returncode == 0 else []:
        logger.info("%s", line)
    return said


def _read(stream: Any, lines: queue.Queue[str]) -> None:
    for line in stream:
        lines.put(line.decode(errors="replace").rstrip())


def _stop(child: subprocess.Popen[bytes]) -> None:
    """Let the command write a checkpoint and end; what does not is killed, which runs survive."""
    if child.poll() is None:
        child.send_signal(signal.SIGINT if os.name == "posix" else signal.SIGTERM)
        try:
            child.wait(_SAVING_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def _reason(status: int, said: Sequence[str]) -> str:
    """Why the command failed, in words of Python."""
    if status < 0:
        return f"the training was ended by signal {-status}; resume= goes on from the last checkpoint"
    begin = next((at for at, line in enumerate(said) if line.startswith("error: ")), None)
    if begin is None:
        return "\n".join(said) or f"the training ended with status {status}"
    text = "\n".join(said[begin:]).removeprefix("error: ").split("\n\nUsage:")[0].strip()
    without, _, build = text.partition(": in a checkout, cargo install")
    if build:
        return f"{without}, which every wheel has; install one, or build it in a checkout by `cargo xtask wheel`"
    # Not in commands, which are between backticks.
    parts = text.split("`")
    return "`".join(re.sub(r"--([a-z][a-z-]*)(?: (?=[A-Z<]))?", _argument, part) if at % 2 == 0 else part for at, part in enumerate(parts))


def _argument(option: re.Match[str]) -> str:
    name = option[1]
    return _NAMES.get(name, name).replace("-", "_") + "="
