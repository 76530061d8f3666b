#!/usr/bin/env bash
# Software:  moviepy 2.2.1: `ImageSequenceClip(frames, fps=fps)` and `write_videofile`, by which Gymnasium's `RecordVideo` writes.
# Expected:  the video has each frame of the list once, in order.
# Happens:   the start of a frame is a sum of 1 / fps, and is compared with i / fps: by rounding, some frames are written twice, those
#            after them are one place late, and others are left out: more the longer the video is.
# Who:       users who bring frames of recorded episodes together with steps, or look for the end of an episode.
# Seen:      of 500 frames at 30 fps 129 are missing, at 10 fps 148, at 60 fps 141; of 100 frames at 30 fps 2 (one more by Python 3.11)
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages moviepy==2.2.1 numpy==2.4.6
"$python" -W ignore - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from moviepy import ImageSequenceClip


def written(count, fps):
    """Indices of the frames that a video of `count` frames gets (`write_videofile` takes them from `iter_frames`)."""
    frames = np.zeros((count, 2, 2, 3), np.uint8)
    frames[:, 0, 0, 0], frames[:, 0, 0, 1] = np.divmod(np.arange(count), 256)
    clip = ImageSequenceClip(list(frames), fps=fps)
    return [int(frame[0, 0, 0]) * 256 + int(frame[0, 0, 1]) for frame in clip.iter_frames(fps=fps)]


def missing(count, fps):
    return sorted(set(range(count)) - set(written(count, fps)))


long = {fps: len(missing(500, fps)) for fps in (10, 30, 60)}
short, right = missing(100, 30), missing(50, 30)
print(f"moviepy {version('moviepy')}, frames that are missing: of 500, by fps {long}; of 100 at 30 fps {short}; of 50 at 30 fps {right}")
print(f"places 72 to 78 of the video of 100 have the frames {written(100, 30)[72:79]}")
assert all(100 < count < 200 for count in long.values()) and short[:2] == [74, 89] and right == []
PYTHON
