"""No memory error from safe Python: arrays outlive what they show, and what may not be written cannot be."""

from __future__ import annotations

import gc
import os
import threading
import time

import numpy as np
import pytest

import stable_worldmodel_rs as swm


def make(num_envs: int = 2, **kwargs: object) -> swm.World:
    return swm.World("swm/PushT-v1", num_envs, image_shape=(32, 32), threads=1, **kwargs)


def churn() -> None:
    """Make freed memory be used again."""
    gc.collect()
    kept = [np.full(4096, 7.5) for _ in range(200)]
    del kept


def test_arrays_outlive_the_world() -> None:
    world = make()
    world.reset(seed=0)
    state, pixels = world.infos["state"], world.infos["pixels"]
    copies = state.copy(), pixels.copy()
    world.close()
    churn()
    np.testing.assert_array_equal(state, copies[0])
    np.testing.assert_array_equal(pixels, copies[1])
    world = make()
    world.reset(seed=0)
    action = world.infos["action"]
    world.step(np.full((2, 2), 0.25))
    rewards = world.envs.results[0]
    kept = rewards.copy()
    del world
    churn()
    np.testing.assert_array_equal(action, np.full((2, 1, 2), 0.25, np.float32))
    np.testing.assert_array_equal(rewards, kept)


def test_arrays_outlive_the_infos_that_a_policy_replaces() -> None:
    world = make()
    world.reset(seed=0)
    state = world.infos["state"]
    kept = state.copy()
    columns = set(world.infos)
    for _ in range(5):
        # A planner has columns of its own, and a random policy has none.
        world.set_policy("cem:samples=4,iterations=1,elites=2,report=plan")
        assert set(world.infos) > columns
        world.set_policy("random")
        assert set(world.infos) == columns
    churn()
    np.testing.assert_array_equal(state, kept)
    assert world.infos["state"] is not state
    np.testing.assert_array_equal(world.infos["state"], kept)
    world.step(np.ones((2, 2)))
    np.testing.assert_array_equal(state, kept)
    assert not np.array_equal(world.infos["state"], kept)


def test_memory_does_not_grow() -> None:
    resource = pytest.importorskip("resource")
    world = swm.World("swm/PushT-v1", 2, add_pixels=False, threads=1, max_episode_steps=None)
    world.reset(seed=0)
    actions = np.zeros((2, 2), np.float32)

    def steps(count: int) -> int:
        for _ in range(count):
            world.step(actions)
            _ = world.rewards
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    before = steps(5_000)
    assert steps(20_000) - before < 4_000


def test_arrays_of_the_core_are_read_only_and_not_resized() -> None:
    world = make()
    world.reset(seed=0)
    with pytest.raises(ValueError):
        world.infos["state"].resize((1000,), refcheck=False)
    for array in [*world.infos.values(), *world.envs.results, world.envs.raw("pixels")]:
        if isinstance(array, np.ndarray):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0
            with pytest.raises(ValueError, match="WRITEABLE"):
                array.setflags(write=True)


def test_a_world_in_use_is_refused_to_others() -> None:
    world = make(2, max_episode_steps=50)
    seen: list[BaseException] = []

    class Calls:
        def get_action(self, infos: dict[str, object]) -> np.ndarray:
            if not seen:
                with pytest.raises(swm.SwmError, match="in use") as error:
                    world.step(np.zeros((2, 2)))
                seen.append(error.value)
            return np.zeros((2, 2))

    world.set_policy(Calls())
    world.evaluate(episodes=2, seed=0)
    assert len(seen) == 1


def test_two_threads_may_have_a_world_each() -> None:
    def run(out: list[float], seed: int) -> None:
        world = make(2)
        world.set_policy("random")
        out.append(float(world.evaluate(episodes=4, seed=seed)["episode_returns"].sum()))

    together: list[list[float]] = [[], []]
    threads = [threading.Thread(target=run, args=(out, 3)) for out in together]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    alone: list[float] = []
    run(alone, 3)
    assert together == [alone, alone]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_world_refuses_a_forked_child_at_once() -> None:
    world = make()
    world.reset(seed=0)
    child = os.fork()
    if child == 0:
        try:
            world.step(np.zeros((2, 2)))
            os._exit(1)
        except swm.SwmError as error:
            os._exit(0 if "fork" in str(error) else 2)
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            assert os.waitstatus_to_exitcode(status) == 0
            return
        time.sleep(0.02)
    os.kill(child, 9)
    os.waitpid(child, 0)
    raise AssertionError("the child hung")
