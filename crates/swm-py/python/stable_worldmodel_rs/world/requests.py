"""Requests that are all in their settings: world models and machines that are measured, planners that are traced, images of episodes, replays."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, cast

from .._access import access_checked
from .._arguments import chosen_episodes, home_path, kind_of, names_of
from .._core import core as _swm
from .._requests import asked
from .ids import native_env, need
from .manifests import Manifest, existing
from .native import checked_shape

AnyPath = str | PathLike[str]


def _size(image_shape: tuple[int, int] | None) -> dict[str, int] | None:
    shape = checked_shape(image_shape)
    return None if shape is None else {"height": shape[0], "width": shape[1]}


@access_checked
def measure(
    env_name: str,
    model: str = "true",
    dataset: AnyPath | None = None,
    *,
    image_shape: tuple[int, int] | None = None,
    probe: Sequence[str] | str | None = None,
    violation: Sequence[str] | str | None = None,
    episodes: int | None = None,
    rows: int | None = None,
    horizon: int | None = None,
    plans: int | None = None,
    seed: int | None = None,
    opening: Mapping[str, Any] | None = None,
    threads: int | None = None,
    progress: bool = True,
    **settings: Any,
) -> dict[str, Any]:
    """Measure a world model without control: open-loop prediction, probes of the state, ranking of plans, violations of expectation. The
    same as ``swm-rs quality``. Ctrl-C ends it with the measurement at work.

    Args:
        env_name: An environment of this package.
        model: A trained one, ``"lewm:RUN"``; or one to compare with: ``"true"``, ``"constant"``, ``"gain=0.8"``, ``"pixels=8"``.
        dataset: Its episodes are predicted and probed; None: episodes of random actions.
        image_shape: (height, width) of the images that the model sees; None: as it was trained, or as recorded.
        probe: What latents are probed for: ``"COLUMN"``, ``"COLUMN[0,1]"``, ``"angle(COLUMN[4])"``; ``["none"]``: nothing; None: what the
            test of success reads.
        violation: Impossible events: ``"teleport"``, ``"COLUMN[ELEMENTS]=VALUES"``, or the name of a factor; None: ``["teleport"]``.
        episodes: N; None: 20. Probes need 100 or more where what they predict changes little within one.
        rows: T, steps of an episode; None: 30.
        horizon: H, steps of open-loop prediction, and actions of a plan; None: 10.
        plans: Plans per start; None: 64.
        seed: Of episodes, plans and probes; None: 42.
        opening: As of `make_manifest`.
        threads: Threads; None: one per core. Results do not depend on it.
        progress: Whether to show a bar.
        **settings: Of the environment.

    Returns:
        ``stride`` (F, steps of one prediction), ``open_loop_error`` and ``open_loop_unexplained`` (``[H // F]``, mean squared errors, and
        their shares of the variance of latents; the second is empty where latents do not vary), ``probes`` (a dict per column: ``column``,
        ``linear``, ``network``), ``ranking`` (``mean``, and ``by_start`` ``[S]``; None without a true cost), ``gate`` (a dict per requirement:
        ``name``, ``found``, ``least``, ``passes``) and ``violations`` (a dict per event: ``name``, ``accuracy``, ``surprise`` ``[2]``, of
        possible and of impossible episodes).

    Raises:
        FileNotFoundError: There is no such dataset.
        TypeError: ``model`` is no text, such as a torch module.
        SwmError: A setting is wrong, or the model does not fit the environment or the dataset; the message names it.

    Example:
        >>> swm.measure("swm/TwoRoom-v2", "constant", episodes=4, rows=8, horizon=3, plans=4)["stride"]
        1
    """
    from ..data._paths import recorded

    if not isinstance(cast("Any", model), str):
        raise TypeError(
            f"model is {kind_of(model)}; give the name of one that can be measured: 'lewm:RUN' of a run of swm.train, 'true', 'constant', 'gain=0.8' or "
            "'pixels=8'. A torch module of your own cannot be measured"
        )
    native, options = native_env(env_name, settings)
    request = {
        "env": native or env_name,
        "env_option": options,
        "model": model,
        "dataset": None if dataset is None else recorded("dataset", dataset),
        "opening": opening,
        "image_size": _size(image_shape),
        "probe": names_of(probe),
        "violation": names_of(violation),
        "episodes": episodes,
        "rows": rows,
        "horizon": horizon,
        "plans": plans,
        "seed": seed,
        "threads": threads,
    }
    return dict(asked("measure", request, progress))


@access_checked
def plan(
    policy: str,
    env_name: str | None = None,
    *,
    manifest: AnyPath | Manifest | None = None,
    pair: int | None = None,
    episodes: int | None = None,
    seed: int | None = None,
    budget: int | None = None,
    plan_only: bool = False,
    trace: AnyPath | None = None,
    overwrite: bool = False,
    details: str | None = None,
    drawn: int | None = None,
    video_format: str | None = None,
    image_shape: tuple[int, int] | None = None,
    frame_skip: int | None = None,
    variation: Sequence[str] | str | None = None,
    variation_values: Mapping[str, Any] | None = None,
    threads: int | None = None,
    progress: bool = True,
    **settings: Any,
) -> dict[str, Any]:
    """Plan with a solver on the true simulator or a model, carry the plans out, and trace the search. The same as ``swm-rs plan``.

    Args:
        policy: A policy of the core that plans: a solver with its settings, ``"cem:samples=300"``, or a model, ``"mpc:RUN"``.
        env_name: An environment of this package; None: that of the manifest.
        manifest: Plan for a pair of it, as it is evaluated, in place of environment, episodes, seed, budget, images and factors.
        pair: With ``manifest``: the pair, counted from 0; None: 0.
        episodes: Episodes, one after the other; None: 1.
        seed: Of starts, goals and noise; None: 42.
        budget: Actions allowed per episode; None: 100.
        plan_only: Only make the first plan of each episode, and take its first action.
        trace: A new folder for ``index.html``, figures, videos, ``result.json`` and ``trace.jsonl``, a line per iteration.
        overwrite: With ``trace``: replace an earlier trace.
        details: With ``trace``: what a line holds: ``"figures"``, ``"elites"`` or ``"candidates"``; None: ``"figures"``.
        drawn: With ``trace``: how many plans get figures; None: 6.
        video_format: With ``trace``: ``"mp4"`` or ``"gif"``; None: mp4 where this build can make it.
        image_shape: With ``trace``: (height, width); None: that of the policy's model, or (224, 224).
        frame_skip: How often each action is applied; None: 1.
        variation: Factors to sample; ``"+NAME"`` in addition to the default ones. ``variation_values``: factors to set.
        threads: Threads; None: one per core. Results do not depend on it.
        progress: Whether to show a bar.
        **settings: Of the environment.

    Returns:
        ``env``, ``policy``, ``seed``, ``frame_skip``, ``episodes`` (a dict each: ``episode``, ``steps``, ``success``), ``plans`` (a dict each:
        ``episode``, ``plan``, ``step``, ``iterations``, ``first_best``, ``last_best``, ``cost``, ``non_finite``, ``wall_time_s``),
        ``wall_time_s``, and ``files``, the paths that were written, the page first.

    Raises:
        SwmError: A setting is wrong, the policy makes no plans, or the folder holds something else.

    Example:
        >>> planned = swm.plan("cem:samples=8,elites=2,iterations=2,horizon=2", "swm/PushT-v1", budget=4, progress=False)
        >>> len(planned["episodes"])
        1
    """
    given = manifest if isinstance(manifest, Manifest) or manifest is None else existing(manifest, "manifest")
    native, options = (None, settings) if env_name is None else native_env(env_name, settings)
    request = {
        "env": native or env_name,
        "env_option": options or None,
        "manifest": given,
        "pair": pair,
        "policy": policy,
        "episodes": episodes,
        "seed": seed,
        "budget": budget,
        "plan_only": plan_only,
        "trace": home_path("trace", trace),
        "overwrite": overwrite,
        "details": details,
        "drawn": drawn,
        "video_format": video_format,
        "image_size": _size(image_shape),
        "frame_skip": frame_skip,
        "vary": names_of(variation),
        "set": variation_values,
        "threads": threads,
    }
    summary, files = asked("plan", request, progress)
    return {**summary, "files": files}


@access_checked
def bench(
    env_name: str, policy: str | None = None, *, seconds: float | None = None, progress: bool = True, **settings: Any
) -> list[dict[str, Any]]:
    """Measure steps per second on this machine, with and without images, by number of threads. The same as ``swm-rs bench``.

    Args:
        env_name: An environment of this package.
        policy: A policy of the core, whose time counts; None: ``"random"``.
        seconds: Of each of 10 measurements, or 15 where there are several cores; None: 1.
        progress: Whether to show a bar.
        **settings: Of the environment.

    Returns:
        Of each measurement ``env``, ``threads``, ``num_envs``, ``pixels`` (whether images were rendered), ``image`` (their size and style) and
        ``steps_per_second``.

    Raises:
        SwmError: A setting is wrong.

    Example:
        >>> swm.bench("swm/PushT-v1", seconds=0.1)[0]["steps_per_second"]  # doctest: +SKIP
        231045.2
    """
    native, options = native_env(env_name, settings)
    request = {"env": native or env_name, "env_option": options, "policy": policy, "seconds": seconds}
    return list(asked("bench", request, progress))


@access_checked
def render(
    out: AnyPath,
    env_name: str,
    policy: str | None = None,
    *,
    seed: int | None = None,
    steps: int | None = None,
    image_shape: tuple[int, int] | None = None,
    variation: Sequence[str] | str | None = None,
    variation_values: Mapping[str, Any] | None = None,
    threads: int | None = None,
    **settings: Any,
) -> dict[str, Any]:
    """Render an episode: ``.png`` its last frame, ``.gif`` and ``.mp4`` all of it. The same as ``swm-rs render``.

    Args:
        out: The file to write. One that exists is replaced.
        env_name: An environment of this package.
        policy: A policy of the core; None: ``"random"``.
        seed: Of the run; None: 0.
        steps: S, steps to take; 0 shows the state after reset; None: 50.
        image_shape: (height, width); None: (224, 224).
        variation: Factors to sample; ``"+NAME"`` in addition to the default ones. ``variation_values``: factors to set.
        threads: Threads; None: one per core. Results do not depend on it.
        **settings: Of the environment.

    Returns:
        ``out``, ``frames`` (1, or up to S + 1), ``height`` and ``width``.

    Raises:
        SwmError: A setting is wrong, or the name of the file ends otherwise.

    Example:
        >>> swm.render("start.png", "swm/PushT-v1", steps=0)["frames"]  # doctest: +SKIP
        1
    """
    native, options = native_env(env_name, settings)
    request = {
        "env": native or env_name,
        "env_option": options,
        "policy": policy,
        "seed": seed,
        "steps": steps,
        "image_size": _size(image_shape),
        "vary": names_of(variation),
        "set": variation_values,
        "threads": threads,
        "out": home_path("out", out),
    }
    return dict(asked("render", request))


@access_checked
def replay(
    path: AnyPath,
    episodes: Sequence[int] | str | None = None,
    *,
    variation_values: Mapping[str, Any] | None = None,
    tolerance: float | None = None,
    env_name: str | None = None,
    progress: bool = True,
    opening: Mapping[str, Any] | None = None,
    threads: int | None = None,
    **settings: Any,
) -> dict[str, Any]:
    """Repeat recorded episodes on the simulator: is the dataset what it says it is? The same as ``swm-rs replay``.

    Args:
        path: A dataset file.
        episodes: Which, by number, or ``"0..10"``; None: all.
        variation_values: Factors to set in place of recorded ones.
        tolerance: Largest accepted difference; None: 1e-6.
        env_name: The environment, where the file does not say.
        progress: Whether to show a bar.
        opening: As of :func:`make_manifest`.
        threads: Threads; None: one per core. Results do not depend on it.
        **settings: Of the environment, beside those that the file names.

    Returns:
        ``ok``, ``episodes``, ``rows``, and the largest differences by column.

    Raises:
        FileNotFoundError: There is no such dataset.
        SwmError: The file names no environment of this package, lacks what a start needs, or a setting is wrong.

    Example:
        >>> swm.replay("pusht.h5", "0..10")["ok"]  # doctest: +SKIP
        True
    """
    from ..data._paths import recorded
    from ..data.native import as_options

    file, opened = recorded("path", path), as_options(opening or {})
    native, options = (None, settings) if env_name is None else native_env(env_name, settings)
    if env_name is None:
        # What the file says; where that is nothing, the replay does.
        for _, run in json.loads(_swm.Reader.open(file, None, json.dumps(opened) if opened else None).runs):
            need(str(run.get("env", "")))
    request = {
        "dataset": file,
        "env": native or env_name,
        "env_option": options,
        "episodes": chosen_episodes(episodes),
        "set": variation_values,
        "tolerance": tolerance,
        "opening": opened,
        "threads": threads,
    }
    return dict(asked("replay", request, progress))
