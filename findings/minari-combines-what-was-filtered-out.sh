#!/usr/bin/env bash
# Software:  minari 0.5.4: `combine_datasets`.
# Expected:  the episodes of the datasets that are given, as they are.
# Happens:   it copies the whole storage behind each: a dataset of `filter_episodes` brings what was filtered out, and the two halves
#            of `split_dataset` all episodes twice. Seeds of episodes are lost.
# Who:       users who select episodes of success, or a part for training, and combine them before they come here.
# Seen:      returns of the best episodes [4.0, 5.0], combined [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]; 4 + 2 episodes combined are 12
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages 'minari[hdf5]==0.5.4' gymnasium==1.4.0 pillow==13.0.0 numpy==2.4.6
MINARI_DATASETS_PATH=$folder "$python" -W ignore - <<'PYTHON'
import gymnasium as gym
import minari
import numpy as np
from minari.data_collector import EpisodeBuffer


def episode(number):
    return EpisodeBuffer(
        id=number,
        seed=100 + number,
        observations=np.zeros((2, 1), np.float32),
        actions=np.zeros((1, 1), np.float32),
        rewards=np.array([float(number)]),
        terminations=np.array([False]),
        truncations=np.array([True]),
    )


def returns(data):
    return [float(one.rewards.sum()) for one in data]


def seeds(data):
    return [one.get("seed") for one in data.storage.get_episode_metadata(range(len(data)))]


space = gym.spaces.Box(-1, 1, (1,), np.float32)
data = minari.create_dataset_from_buffers(
    "whole-v0", [episode(number) for number in range(6)], observation_space=space, action_space=space
)
best = data.filter_episodes(lambda one: one.rewards.sum() > 3)
combined = minari.combine_datasets([best], "best-v0")
halves = minari.split_dataset(data, [4, 2], seed=0)
joined = minari.combine_datasets(halves, "joined-v0")
print(f"minari {minari.__version__}: best {returns(best)}, combined {returns(combined)}; 4 + 2 episodes are {len(joined)}")
print(f"seeds {seeds(data)}, combined {seeds(combined)}")
assert returns(best) == [4, 5] and returns(combined) == [0, 1, 2, 3, 4, 5] == sorted(set(returns(joined))) and len(joined) == 12
assert [int(seed) for seed in seeds(data)] == list(range(100, 106)) and seeds(combined) == [None] * 6
PYTHON
