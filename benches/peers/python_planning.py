"""Cases of python.py about planning: what a solver costs beside its cost, and what a planning policy costs per step.

Both sides are given the same costs in torch; noise differs. A call is an iteration on 8 plans of one value, with a cost that
is ready: Python, the binding and the search, without anything to compute. The policies plan every 25 steps.
"""

import numpy as np
from python_cases import Case

ITERATIONS = 1000
SAMPLES = 8
ENVS = 8


class Shared(Case):
    """What a case makes of a package's modules, on either side."""

    def ours(self):
        from stable_worldmodel_rs import planning, policy

        return self.work(planning, policy)

    def work(self, planning, policy):
        raise NotImplementedError


class Compared(Shared):
    """A case that the reference has, too."""

    def reference(self):
        from stable_worldmodel import planning, policy

        return self.work(planning, policy)


def box(*shape):
    import gymnasium

    return gymnasium.spaces.Box(-1, 1, shape, np.float32)


class ArrayCall(Shared):
    """An iteration with a NumPy cost."""

    name = "plan/call/numpy"
    most_us = 5

    def work(self, planning, policy):
        class Ready:
            array_api = "numpy"
            costs = np.arange(SAMPLES, dtype=np.float64)[None]

            def get_cost(self, info, candidates):
                return self.costs

        return call(planning, policy, Ready(), {"state": np.zeros((1, 3))})


class TensorCall(Compared):
    """An iteration with a torch cost."""

    name = "plan/call/torch"

    def work(self, planning, policy):
        import torch

        class Ready:
            costs = torch.arange(SAMPLES)[None].float()

            def get_cost(self, info, candidates):
                return self.costs

        return call(planning, policy, Ready(), {"state": torch.zeros(1, 3)})


def call(planning, policy, cost, infos):
    solver = planning.CEMSolver(cost, num_samples=SAMPLES, n_steps=ITERATIONS, topk=4)
    solver.configure(action_space=box(1, 1), n_envs=1, config=policy.PlanConfig(horizon=1, receding_horizon=1))

    def work():
        solver.solve(infos)
        return ITERATIONS

    return work


class Plans(Compared):
    """Plans of 8 environments: 30 iterations on 300 plans of 5 blocks of 5 actions, with a sum of squares in torch."""

    name = "plan/cem"

    def work(self, planning, policy):
        import torch

        class Squares:
            def get_cost(self, info, candidates):
                return candidates.pow(2).sum(dim=(2, 3))

        solver = planning.CEMSolver(Squares(), batch_size=ENVS)
        config = policy.PlanConfig(horizon=5, receding_horizon=5, action_block=5)
        solver.configure(action_space=box(ENVS, 2), n_envs=ENVS, config=config)
        infos = {"state": torch.zeros(ENVS, 1, 7)}

        def work():
            solver.solve(infos)
            return ENVS

        return work


class Steps(Compared):
    """Steps of a planning policy in 8 environments with images of 64 × 64, between plans that cost next to nothing."""

    name = "plan/policy/64"

    def work(self, planning, policy):
        import torch

        class Squares:
            def get_cost(self, info, candidates):
                return candidates.pow(2).sum(dim=(2, 3))

        class Envs:
            num_envs = ENVS
            single_action_space = box(2)
            action_space = box(ENVS, 2)

        def transform(image):
            return image.float() / 255

        solver = planning.CEMSolver(Squares(), batch_size=ENVS, num_samples=16, n_steps=1, topk=4)
        config = policy.PlanConfig(horizon=5, receding_horizon=5, action_block=5)
        planner = policy.WorldModelPolicy(solver, config, transform={"pixels": transform, "goal": transform})
        planner.set_env(Envs())
        images = np.zeros((ENVS, 1, 64, 64, 3), np.uint8)
        infos = {"pixels": images, "goal": images.copy(), "state": np.zeros((ENVS, 1, 7))}
        torch.set_num_threads(1)

        def work():
            for _ in range(config.plan_len):
                planner.get_action(dict(infos))
            return config.plan_len * ENVS

        return work


CASES = [ArrayCall(), TensorCall(), Plans(), Steps()]
