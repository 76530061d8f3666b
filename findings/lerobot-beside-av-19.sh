#!/usr/bin/env bash
# Software:  lerobot 0.6.1 beside av 19.0.2 (Python 3.12 or later), installed as `lerobot av` and not as `lerobot[dataset]`.
# Expected:  pip refuses versions that do not go together, or the import works.
# Happens:   the bounds of av are in an extra, so that pip and `pip check` are content, and datasets of LeRobot cannot be imported.
# Who:       users who convert to LeRobot in the environment in which they read videos by PyAV.
# Seen:      AttributeError: module 'av' has no attribute 'option'
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages lerobot==0.6.1 av==19.0.2 datasets==5.2.0
"$python" -m pip check | tail -1
"$python" - 2>/dev/null <<'PYTHON'
from importlib.metadata import version

try:
    import lerobot.datasets.lerobot_dataset
    raise SystemExit("imports: changed")
except AttributeError as error:
    print(f"lerobot {version('lerobot')}, av {version('av')}: AttributeError: {error}")
    assert "option" in str(error)
PYTHON
