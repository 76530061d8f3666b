"""Ctrl-C ends long native calls, and exceptions of Python code come out as themselves."""

from __future__ import annotations

import os
import signal
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import stable_worldmodel_rs as swm

# From the signal to the exception; the goal is 0.3 s on a quiet machine.
PATIENCE = 1.5 if os.environ.get("CI") else 0.6


@pytest.fixture(autouse=True)
def _ctrl_c_raises() -> None:
    # A shell starts background jobs with the signal ignored, and Python then leaves it so.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def make(num_envs: int = 2) -> swm.World:
    return swm.World("swm/PushT-v1", num_envs, image_shape=(32, 32), threads=1)


def interrupted(call: Callable[[], object], after: float = 0.4) -> float:
    """How long after SIGINT the call ended."""
    sent: list[float] = []

    def send() -> None:
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(after, send)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            call()
        return time.monotonic() - sent[0]
    finally:
        timer.cancel()


class Still:
    def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
        return np.zeros((len(infos["state"]), 2))


@pytest.mark.skipif(os.name == "nt", reason="signals are sent otherwise there")
@pytest.mark.parametrize("policy", ["expert", "random", "cem:samples=64,horizon=5", Still()])
def test_evaluations_end_at_once(policy: object) -> None:
    world = make()
    world.set_policy(policy)
    assert interrupted(lambda: world.evaluate(episodes=1_000_000, seed=0)) < PATIENCE
    # The World is usable again.
    world.set_policy(Still())
    assert world.evaluate(episodes=2, seed=0)["episodes"] == 2


@pytest.mark.skipif(os.name == "nt", reason="signals are sent otherwise there")
def test_recordings_end_at_once_and_keep_what_was_written(tmp_path: Path) -> None:
    world = make()
    world.set_policy("random")
    path = tmp_path / "a.h5"
    assert interrupted(lambda: world.collect(path, episodes=1_000_000, seed=0, progress=False)) < PATIENCE
    held = len(swm.data.load_dataset(str(path)).lengths)
    assert held > 0
    more = world.collect(path, episodes=2, seed=0, mode="append", progress=False)
    assert more["total_episodes"] == held + 2


@pytest.mark.skipif(os.name == "nt", reason="signals are sent otherwise there")
@pytest.mark.parametrize("model", ["true", "constant"])
def test_measures_end_with_the_measurement_at_work(model: str) -> None:
    def measure(episodes: int = 3000) -> dict[str, object]:
        return swm.measure("swm/TwoRoom-v2", model, episodes=episodes, rows=30, horizon=10, plans=64, threads=1, progress=False)

    assert interrupted(measure) < 3 * PATIENCE
    # While episodes are recorded.
    assert interrupted(lambda: measure(episodes=10_000_000)) < PATIENCE
    assert measure(episodes=4)["stride"] == 1


@pytest.mark.parametrize("native_writer", [True, False])
def test_exceptions_of_a_policy_keep_their_traceback(native_writer: bool, tmp_path: Path) -> None:
    class Broken:
        def get_action(self, infos: dict[str, np.ndarray]) -> np.ndarray:
            raise LookupError("the model is lost")

    class Writer:
        def write_episodes(self, episodes: object) -> None:
            list(episodes)  # type: ignore[call-overload]

    world = make()
    world.set_policy(Broken())
    where = {"path": tmp_path / "a.h5"} if native_writer else {"writer": Writer()}
    with pytest.raises(LookupError, match="the model is lost") as error:
        world.collect(**where, episodes=2, seed=0, progress=False)
    assert any(frame.name == "get_action" for frame in traceback.extract_tb(error.value.__traceback__))
    with pytest.raises(LookupError):
        world.evaluate(episodes=1, seed=0)


def test_exceptions_of_a_writer_come_out() -> None:
    class Full:
        def write_episodes(self, episodes: object) -> None:
            next(iter(episodes))  # type: ignore[call-overload]
            raise OSError("no space left")

    world = make()
    world.set_policy("random")
    with pytest.raises(OSError, match="no space left"):
        world.collect(writer=Full(), episodes=1000, seed=0, progress=False)
    assert world.evaluate(episodes=1, seed=0)["episodes"] == 1
