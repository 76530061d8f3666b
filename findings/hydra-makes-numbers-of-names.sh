#!/usr/bin/env bash
# Software:  hydra-core 1.3.8 with omegaconf 2.3.1: `key=value` on the command line, and YAML.
# Expected:  2026_11_29 and the commit 4e12345 stay text, as 2026-11-29 does; a field of type str keeps what was typed.
# Happens:   underscores are left out (20261129), and digits with one e are a power of ten (inf); a field of type str gets the text of
#            that number. In YAML, 1:30 is 90 and 007 is 7, too.
# Who:       users who name runs, datasets and commits in overrides: two commits are both `inf`, and a folder has another name.
# Seen:      run 20261129, commit inf, in a field of type str '20261129' and 'inf'; YAML: a clip of 1:30 is 90
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages hydra-core==1.3.8 omegaconf==2.3.1
cat >"$folder/run.py" <<'PYTHON'
from dataclasses import dataclass

import hydra
from hydra.core.config_store import ConfigStore
from omegaconf import OmegaConf


@dataclass
class Config:
    run: str = ""
    commit: str = ""


ConfigStore.instance().store(name="typed", node=Config)


@hydra.main(version_base=None, config_name="typed")
def main(config):
    untyped = {key[1:]: config[key] for key in ("_run", "_commit", "_day")}
    typed = {"run": config.run, "commit": config.commit}
    yaml = dict(OmegaConf.create("run: 2026_11_29\ncommit: 4e12345\nclip: 1:30\nid: 007"))
    print(f"hydra {hydra.__version__}: untyped {untyped}, str fields {typed}, YAML {yaml}")
    assert untyped == {"run": 20261129, "commit": float("inf"), "day": "2026-11-29"}
    assert typed == {"run": "20261129", "commit": "inf"}
    assert yaml == {"run": 20261129, "commit": float("inf"), "clip": 90, "id": 7}


main()
PYTHON
cd "$folder"
"$python" run.py run=2026_11_29 commit=4e12345 +_run=2026_11_29 +_commit=4e12345 +_day=2026-11-29 hydra.run.dir=. hydra.output_subdir=null
