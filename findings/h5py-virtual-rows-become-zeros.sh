#!/usr/bin/env bash
# Software:  h5py 3.16.0 with its HDF5 2.0: a virtual dataset that joins episodes of several files.
# Expected:  an error that names the file that is missing, as for an external link.
# Happens:   rows of a file that was moved, renamed or not copied are read as zeros, and so are those of a file whose dataset has
#            another name; no error, no warning.
# Who:       users who join recordings by `create_virtual_dataset` and copy the joined file to another machine.
# Seen:      [1.0, 1.0, 2.0, 2.0]; without the second file [1.0, 1.0, 0.0, 0.0]; an external link: KeyError
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages h5py==3.16.0 numpy==2.4.6
"$python" - "$folder" <<'PYTHON'
import os
import sys

import h5py
import numpy as np

os.chdir(sys.argv[1])
layout = h5py.VirtualLayout((4,), "f4")
for episode in range(2):
    with h5py.File(f"{episode}.h5", "w") as file:
        file["action"] = np.full(2, episode + 1.0, "f4")
    layout[2 * episode : 2 * episode + 2] = h5py.VirtualSource(f"{episode}.h5", "action", (2,))
with h5py.File("all.h5", "w") as file:
    file.create_virtual_dataset("action", layout)
    file["link"] = h5py.ExternalLink("1.h5", "action")


def read():
    with h5py.File("all.h5") as file:
        return file["action"][:].tolist()


whole = read()
with h5py.File("1.h5", "a") as file:
    file.move("action", "actions")
renamed = read()
os.remove("1.h5")
missing = read()
with h5py.File("all.h5") as file:
    try:
        link = file["link"][:].tolist()
    except KeyError:
        link = "KeyError"
print(f"h5py {h5py.__version__}: {whole}; dataset renamed {renamed}; file missing {missing}; external link {link}")
assert whole == [1, 1, 2, 2] and renamed == missing == [1, 1, 0, 0] and link == "KeyError"
PYTHON
