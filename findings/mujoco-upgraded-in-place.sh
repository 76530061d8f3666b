#!/usr/bin/env bash
# Software:  mujoco 3.17.0, upgraded by `pip install mujoco==4.0.0` in the same environment.
# Expected:  `import mujoco` works after the upgrade.
# Happens:   it fails: version 4 is divided into packages that share a folder, and uninstalling 3 removes files that
#            mujoco-core had just put there. pip ends with success.
# Who:       everybody who upgrades an environment with dm_control, gymnasium-robotics or ogbench in it.
# Seen:      ImportError: The 'mujoco' package is installed, but its core bindings ('mujoco-core') are missing or corrupted …
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
unset FINDINGS_PYTHON  # An environment of its own: it is changed.
packages mujoco==3.17.0
"$python" -c 'import mujoco; print("first", mujoco.__version__)'
"$python" -m pip install --quiet --disable-pip-version-check mujoco==4.0.0
if "$python" -c 'import mujoco' 2>"$folder/error"; then
    echo "mujoco 4.0.0 over 3.17.0 imports: changed"
    exit 1
fi
echo "mujoco 4.0.0 over 3.17.0: $(grep '^ImportError' "$folder/error")"
grep -q "mujoco-core" "$folder/error"
