#!/usr/bin/env bash
# Software:  torchrl 0.14.1 with torch 2.15.0: `SliceSampler` on a replay buffer of episodes of different lengths.
# Expected:  each slice of the buffer is as likely as any other, as from a replay buffer of single steps.
# Happens:   an episode is chosen first, each as likely as any other whatever its length, and a slice within it then: a step of a short
#            episode is seen more often by the ratio of the lengths. `PrioritizedSliceSampler` chooses by steps. (The manual names neither.)
# Who:       users who train world models on slices of episodes that end early by failure or success: steps of long episodes are rare.
# Seen:      share of episodes of 10, 10, 10 and 1000 steps: 0.24, 0.25, 0.25, 0.26; with priorities that are equal 0.01, 0.01, 0.00, 0.98
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages torchrl==0.14.1 tensordict==0.14.3 torch==2.15.0 numpy==2.4.6
RL_LOGGING_LEVEL=WARNING "$python" -W ignore - 2>"$folder/log" <<'PYTHON' || { cat "$folder/log"; exit 1; }
import torch
import torchrl
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, PrioritizedSliceSampler, SliceSampler, TensorDictReplayBuffer

LENGTHS = [10, 10, 10, 1000]


def shares(sampler):
    torch.manual_seed(0)
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(2000), sampler=sampler, batch_size=40)
    episode = torch.cat([torch.full((length,), i) for i, length in enumerate(LENGTHS)])
    done = torch.cat([torch.arange(length) == length - 1 for length in LENGTHS])[:, None]
    buffer.extend(TensorDict({"episode": episode, ("next", "done"): done}, batch_size=[len(episode)]))
    counts = sum(torch.bincount(buffer.sample()["episode"].flatten(), minlength=len(LENGTHS)) for _ in range(200))
    return [round(share, 3) for share in (counts / counts.sum()).tolist()]


by_episode = shares(SliceSampler(slice_len=4, traj_key="episode")), shares(SliceSampler(slice_len=4, end_key=("next", "done")))
by_step = shares(PrioritizedSliceSampler(2000, alpha=0.7, beta=0.9, slice_len=4, traj_key="episode"))
print(f"torchrl {torchrl.__version__}: share of steps of episodes of {LENGTHS} steps: SliceSampler by traj_key and by end_key")
print(f"{by_episode[0]}, {by_episode[1]}; PrioritizedSliceSampler {by_step}; steps that are there: 0.010, 0.010, 0.010, 0.971")
assert all(abs(share - 0.25) < 0.03 for shares in by_episode for share in shares) and by_step[-1] > 0.95
PYTHON
