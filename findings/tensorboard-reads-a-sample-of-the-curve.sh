#!/usr/bin/env bash
# Software:  tensorboard 2.21.0: `EventAccumulator`, on event files of tensorboardX 2.6.5.
# Expected:  `Scalars(tag)` gives the values that were logged.
# Happens:   of more than 10,000 values of a tag it gives 10,000, at random: the greatest may be missing. The last one is kept. No
#            warning. TensorBoard's page shows 1,000 of a tag.
# Who:       users who take best returns, success rates or curves of long trainings from event files.
# Seen:      30,000 values, one of 1000 at step 12345: 10,000 are read, the greatest is 0.99997; with size_guidance 0: 30,000, 1000
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages tensorboard==2.21.0 tensorboardX==2.6.5 numpy==2.4.6
"$python" -W ignore - "$folder/run" 2>/dev/null <<'PYTHON'
import sys
from importlib.metadata import version

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboardX import SummaryWriter

with SummaryWriter(sys.argv[1]) as writer:
    for step in range(30_000):
        writer.add_scalar("return", 1000 if step == 12_345 else step / 30_000, step)


def read(**options):
    values = EventAccumulator(sys.argv[1], **options).Reload().Scalars("return")
    return len(values), round(max(event.value for event in values), 5), values[-1].step


default, whole = read(), read(size_guidance={"scalars": 0})
print(f"tensorboard {version('tensorboard')}: values, greatest, last step: {default}; with size_guidance 0: {whole}")
assert default == (10_000, 0.99997, 29_999) and whole == (30_000, 1000, 29_999)
PYTHON
