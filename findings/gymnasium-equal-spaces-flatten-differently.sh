#!/usr/bin/env bash
# Software:  gymnasium 1.4.0 and minari 0.5.4: `spaces.flatten` and `FlattenObservation` of a `Dict` space.
# Expected:  equal spaces give equal vectors; a Minari dataset has the space of the environment that it was recorded from.
# Happens:   the vector has the order of the space's keys: sorted if it was made from a plain dict, as given if from keywords or a
#            list, and `==` passes over the order. The space of a dataset is made from a dict, so its order is the sorted one.
# Who:       users who train on a dataset's flattened observations and act in the environment by `FlattenObservation`.
# Seen:      {position: [1, 2], goal: [3]}: the environment [1, 2, 3], its dataset [3, 1, 2]; spaces are equal: True
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages 'minari[hdf5]==0.5.4' gymnasium==1.4.0 pillow==13.0.0 numpy==2.4.6
MINARI_DATASETS_PATH=$folder "$python" -W ignore - <<'PYTHON'
import gymnasium as gym
import minari
import numpy as np
from gymnasium.spaces import Box, Dict, flatten
from minari.data_collector import EpisodeBuffer

position, goal = Box(-9, 9, (2,), np.float64), Box(-9, 9, (1,), np.float64)
observation = {"position": np.array([1.0, 2.0]), "goal": np.array([3.0])}


class Reach(gym.Env):
    observation_space = Dict(position=position, goal=goal)
    action_space = goal

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return observation, {}


episode = EpisodeBuffer(
    id=0,
    observations={key: np.stack([value, value]) for key, value in observation.items()},
    actions=np.zeros((1, 1)),
    rewards=np.zeros(1),
    terminations=np.array([True]),
    truncations=np.array([False]),
)
minari.create_dataset_from_buffers(
    "reach-v0", [episode], observation_space=Reach.observation_space, action_space=Reach.action_space
)
data = minari.load_dataset("reach-v0")
first = {key: values[0] for key, values in data[0].observations.items()}
acted, _ = gym.wrappers.FlattenObservation(Reach()).reset()
learned = flatten(data.observation_space, first)
plain = flatten(Dict({"position": position, "goal": goal}), observation)
equal = data.observation_space == Reach.observation_space
print(f"gymnasium {gym.__version__}, minari {minari.__version__}: equal spaces: {equal}")
print(f"environment {acted.tolist()}, its dataset {learned.tolist()}, a space from a dict {plain.tolist()}")
assert equal and acted.tolist() == [1, 2, 3] and learned.tolist() == plain.tolist() == [3, 1, 2]
PYTHON
