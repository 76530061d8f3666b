#!/usr/bin/env bash
# Software:  minari 0.5.4: `iterate_episodes(indices)` of a dataset from `split_dataset` or `filter_episodes`.
# Expected:  index i is the episode that `dataset[i]` gives, or an error where an episode is not of this part.
# Happens:   indices are those of the whole file: `test.iterate_episodes(range(len(test)))` gives the first episodes of the file, which
#            are of the training part, and of a filtered dataset those that were filtered out.
# Who:       users who evaluate on a few episodes of a test split, or choose indices below `len(dataset)` at random.
# Seen:      test episodes [3, 7], training [5, 0, 1, 4, 2, 6]: test[i] gives [3, 7], test.iterate_episodes(range(2)) gives [0, 1]
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
        observations=np.zeros((2, 1), np.float32),
        actions=np.zeros((1, 1), np.float32),
        rewards=np.array([float(number)]),
        terminations=np.array([False]),
        truncations=np.array([True]),
    )


def ids(episodes):
    return [int(one.id) for one in episodes]


space = gym.spaces.Box(-1, 1, (1,), np.float32)
data = minari.create_dataset_from_buffers(
    "whole-v0", [episode(number) for number in range(8)], observation_space=space, action_space=space
)
train, test = minari.split_dataset(data, [6, 2], seed=1)
best = data.filter_episodes(lambda one: one.rewards.sum() > 5)
by_index, iterated = ids(test[index] for index in range(len(test))), ids(test.iterate_episodes(range(len(test))))
returns = [float(one.rewards.sum()) for one in best.iterate_episodes(range(len(best)))]

print(f"minari {minari.__version__}: training {ids(train)}, test {ids(test)}: test[i] {by_index}, iterated by index {iterated}")
print(f"returns over 5: {[float(one.rewards.sum()) for one in best]}, iterated by index {returns}")
assert by_index == ids(test) and iterated == [0, 1] and set(iterated) <= set(ids(train)) and returns == [0, 1]
PYTHON
