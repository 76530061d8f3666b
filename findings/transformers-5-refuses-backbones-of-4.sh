#!/usr/bin/env bash
# Software:  transformers 4.57.6 and 5.24.0: the configuration of a DINOv2 backbone.
# Expected:  5 loads what 4 saved: weights and code of the layer are unchanged, and its hidden size is int(hidden_size * mlp_ratio).
# Happens:   5 checks types of fields: `mlp_ratio` must be an int and `layerscale_value` a float, so that 4.0, 2.5 and 1 are refused,
#            before a weight is read. Other models (vjepa2) have `mlp_ratio` as a float, and take them.
# Who:       users whose world model has a DINOv2 backbone that was trained or written with transformers 4.
# Seen:      4.57.6 saves and loads all three; 5.24.0: Field 'mlp_ratio' expected int, got float (value: 2.5)
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages transformers==4.57.6
"$python" - "$folder" <<'PYTHON'
import sys

import transformers
from transformers import AutoConfig, Dinov2Config, VJEPA2Config

fields = {"whole": {"mlp_ratio": 4.0}, "part": {"mlp_ratio": 2.5}, "scale": {"layerscale_value": 1}}
for name, values in fields.items():
    Dinov2Config(**values).save_pretrained(f"{sys.argv[1]}/{name}")
    loaded = AutoConfig.from_pretrained(f"{sys.argv[1]}/{name}")
    assert all(getattr(loaded, field) == value for field, value in values.items())
VJEPA2Config(mlp_ratio=2.5).save_pretrained(f"{sys.argv[1]}/other")
print(f"transformers {transformers.__version__}: saves and loads {fields}")
PYTHON
packages transformers==5.24.0
"$python" - "$folder" <<'PYTHON'
import sys

import transformers
from transformers import AutoConfig

print(f"transformers {transformers.__version__}:")
for name in ["whole", "part", "scale"]:
    try:
        AutoConfig.from_pretrained(f"{sys.argv[1]}/{name}")
        raise SystemExit(f"{name} is loaded: changed")
    except Exception as error:
        text = " ".join(str(error).split())
        print(f"  {name}: {text}")
        assert "expected int, got float" in text or "expected float, got int" in text
assert AutoConfig.from_pretrained(f"{sys.argv[1]}/other").mlp_ratio == 2.5
PYTHON
