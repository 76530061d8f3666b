"""`doctor` looks where the package looks: models of an installed `ogbench` work, and what no wheel carries is optional."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from stable_worldmodel_rs import _swm


def doctor(home: Path, site: Path, **environment: str) -> tuple[int, dict[str, dict[str, Any]]]:
    """The exit status, and the checks by name, with a data folder at ``home`` and further packages in ``site``."""
    variables = {name: value for name, value in os.environ.items() if name not in ("SWM_HOME", "SWM_MUJOCO_LIB")}
    variables |= {"XDG_DATA_HOME": str(home), "XDG_CACHE_HOME": str(home / "cache"), **environment}
    variables["PYTHONPATH"] = os.pathsep.join([*(path for path in sys.path if path), str(site)])
    words = [sys.executable, "-m", "stable_worldmodel_rs", "doctor", "--json"]
    done = subprocess.run(words, env=variables, capture_output=True, text=True, timeout=300)
    return done.returncode, {check["what"]: check for check in json.loads(done.stdout)}


def installed(site: Path, folder: Path, version: str) -> None:
    """Puts a package ``ogbench`` with the models of the data folder into ``site``."""
    models = next((folder / "ogbench").iterdir())
    for source, place in [("manipspace/descriptions", "manipspace"), ("locomaze/assets", "locomaze")]:
        (site / "ogbench" / source).parent.mkdir(parents=True, exist_ok=True)
        (site / "ogbench" / source).symlink_to(models / place, target_is_directory=True)
    (site / "ogbench/__init__.py").write_text("")
    info = site / f"ogbench-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: ogbench\nVersion: {version}\n")


@pytest.mark.skipif(sys.platform != "linux", reason="the data folder is found by XDG_DATA_HOME")
def test_models_of_an_installed_ogbench_work(tmp_path: Path, ogbench: None) -> None:
    _, folder, (_, _, version, _) = _swm.files()
    assert folder is not None
    home = tmp_path / "share" / "stable-worldmodel"
    home.mkdir(parents=True)
    for name in ("mujoco", "dm_control"):
        (home / name).symlink_to(folder / name, target_is_directory=True)
    (empty := tmp_path / "empty").mkdir()
    status, without = doctor(home.parent, empty)
    assert without["models of OGBench"]["state"] == without["models of Fetch"]["state"] == "optional", without
    assert f"pip install ogbench=={version}" in without["models of OGBench"]["fix"]
    assert status == 0 and without["environments"]["state"] == "optional", without
    installed(site := tmp_path / "site", folder, version)
    status, found = doctor(home.parent, site)
    assert status == 0 and found["models of OGBench"]["state"] == "works", found
    assert "swm/OGB" not in found["environments"]["found"], found
    # The library of a wheel is in the package; elsewhere it is that of the data folder, which is compared with what was published.
    in_package = "_lib" in found["MuJoCo"]["found"]
    assert found["MuJoCo"]["state"] == "works" and (in_package or "as published" in found["MuJoCo"]["found"]), found
    installed(older := tmp_path / "older", folder, "1.1.0")
    status, found = doctor(home.parent, older)
    assert status == 0 and "pip install ogbench==1.2.2" in found["models of OGBench"]["fix"], found
