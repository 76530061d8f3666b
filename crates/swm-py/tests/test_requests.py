"""One request from Python and from the command gives equal files. The tables are those of ``tests/integration/requests.rs``."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm

TABLES = Path(__file__).parents[3] / "tests" / "requests"
# Settings that have another name in Python.
NAMES = {"distractor": "distractors", "vary": "variation", "set": "variation_values", "env": "env_name"}


def arguments(request: dict[str, Any]) -> dict[str, Any]:
    """The keyword arguments of a request."""
    given = {NAMES.get(name, name): value for name, value in request.items()}
    if size := given.pop("image_size", None):
        given["image_shape"] = (size["height"], size["width"])
    values = given.get("variation_values", {})
    for name, value in values.items():
        if isinstance(value, list):
            values[name] = np.array(value)
    settings = given.pop("env_option", {})
    return {**given, **settings}


def words(request: dict[str, Any]) -> list[str]:
    """The words of the command for a request."""

    def text(value: Any) -> str:
        return ",".join(map(str, value)) if isinstance(value, list) else str(value)

    found: list[str] = []
    for name, value in request.items():
        option = "--" + name.replace("_", "-")
        if name == "env" and "baseline" not in request:
            found.insert(0, value)
        elif name in ("source", "sources", "first", "second") or (name == "dataset" and not {"env", "baseline"} & request.keys()):
            place = next((at for at, word in enumerate(found) if word.startswith("--")), len(found))
            found[place:place] = [value] if isinstance(value, str) else value
        elif name == "opening":
            for key, one in value.items():
                pairs = [f"{new}={old}" for new, old in one.items()] if isinstance(one, dict) else [text(one)]
                found += [word for pair in pairs for word in ("--" + key, pair)]
        elif value is True:
            found.append(option)
        elif value is False:
            found.append("--no-" + option[2:])
        elif name in ("distractor", "probe", "violation"):
            found += [word for one in value for word in (option, one)]
        elif name == "baseline":
            found.insert(0, value)
        elif name in ("set", "env_option", "look"):
            found += [word for key, one in value.items() for word in (option, f"{key}={text(one)}")]
        elif name == "image_size" and value is None:
            found += [option, "none"]
        elif name == "image_size":
            found += [option, f"{value['height']}x{value['width']}"]
        else:
            found += [option, text(value)]
    return found


def test_a_manifest_is_the_same_from_python_and_the_command(command: str, tmp_path: Path) -> None:
    data = tmp_path / "a.h5"
    collect = "collect swm/PushT-v1 --policy weak --episodes 30 --max-steps 60 --image-size none --seed 3 --quiet --out"
    subprocess.run([command, *collect.split(), data], check=True)
    text = (TABLES / "make_manifest.json").read_text().replace("DATA", str(data))
    for index, request in enumerate(json.loads(text)):
        ours, theirs = tmp_path / f"python-{index}.toml", tmp_path / f"command-{index}.toml"
        subprocess.run([command, "manifest", "make", *words(request), "--out", theirs, "--quiet"], check=True)
        swm.make_manifest(ours, **arguments(request))
        assert ours.read_bytes() == theirs.read_bytes(), request


def test_a_receipt_is_the_same_from_python_and_the_command(command: str, tmp_path: Path) -> None:
    task = tmp_path / "task.toml"
    swm.make_manifest(task, "swm/PushT-v1", 3, budget=6)
    for index, request in enumerate(json.loads((TABLES / "evaluate.json").read_text())):
        ours, theirs = tmp_path / f"python-{index}", tmp_path / f"command-{index}"
        subprocess.run([command, "eval", "--manifest", task, *words(request), "--out", theirs, "--quiet"], check=True)
        given = {"references" if name == "reference" else name: value for name, value in request.items()}
        swm.evaluate(task, out=ours, progress=False, **given)
        first, other = (
            [line for line in (folder / "receipt.json").read_text().splitlines() if '"wall_time_s"' not in line]
            for folder in (ours, theirs)
        )
        assert first == other, request


def test_a_sweep_is_the_same_from_python_and_the_command(command: str, tmp_path: Path) -> None:
    task = tmp_path / "task.toml"
    swm.make_manifest(task, "swm/PushT-v1", 3, budget=6)
    for index, request in enumerate(json.loads((TABLES / "sweep.json").read_text())):
        ours, theirs = tmp_path / f"python-{index}", tmp_path / f"command-{index}"
        subprocess.run([command, "sweep", "--manifest", task, *words(request), "--out", theirs, "--quiet"], check=True)
        swm.sweep(task, out=ours, progress=False, **request)
        for file in ("sweep.json", "sweep.csv", "sweep.svg"):
            assert (ours / file).read_bytes() == (theirs / file).read_bytes(), request


def recorded(request: dict[str, Any], out: Path) -> None:
    """A request of the table, from Python."""
    size = request.get("image_size", {"height": 64, "width": 64})
    world = swm.World(
        request["env"],
        request.get("num_envs", 2),
        None if size is None else (size["height"], size["width"]),
        request["max_steps"],
        add_pixels=size is not None,
        frame_skip=request.get("frame_skip", 1),
        unrecorded=request.get("without", ()),
        **request.get("env_option", {}),
    )
    world.set_policy(request.get("policy", "random"))
    names = {"vary": "variation", "set": "variation_values"}
    options = {there: request[here] for here, there in names.items() if here in request}
    seed, every = request.get("seed", 0), request.get("replayable")
    world.collect(out, request["episodes"], seed, options or None, replayable=every, progress=False)


def test_a_recording_is_the_same_from_python_and_the_command(command: str, tmp_path: Path) -> None:
    for index, request in enumerate(json.loads((TABLES / "record.json").read_text())):
        ours, theirs = tmp_path / f"python-{index}.h5", tmp_path / f"command-{index}.h5"
        subprocess.run([command, "collect", *words(request), "--out", theirs, "--quiet"], check=True)
        recorded(request, ours)
        assert ours.read_bytes() == theirs.read_bytes(), request


@pytest.fixture(scope="module")
def recordings(command: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Those of ``tests/integration/requests.rs``."""
    folder = tmp_path_factory.mktemp("recordings")
    for name, more in {
        "a.h5": "--episodes 3 --image-size 20x20 --vary agent.color --seed 1",
        "b.h5": "--episodes 2 --image-size 20x20 --seed 2",
        "small.h5": "--episodes 1 --image-size 8x8 --seed 3",
        "part1.h5": "--total 4 --shard 1/2 --image-size 20x20",
    }.items():
        collect = f"collect swm/PushT-v1 --policy weak --max-steps 6 --quiet {more} --out"
        subprocess.run([command, *collect.split(), folder / name], check=True)
    return folder


def copies(table: str, recordings: Path) -> list[dict[str, Any]]:
    """The requests of a table on recordings and datasets of other programs."""
    field = TABLES.parent / "golden" / "field"
    text = (TABLES / table).read_text().replace("DATA", str(recordings)).replace("FIELD", str(field))
    return list(json.loads(text))


def copied(request: dict[str, Any], out: Path) -> None:
    """A copy of the table, from Python."""
    given = dict(request)
    if size := given.pop("image_size", None):
        given["image_size"] = (size["height"], size["width"])
    given["dest_format"] = given.pop("format", None)
    if given.pop("overwrite", False):
        given["mode"] = "overwrite"
    if "key_frames" in given:
        given["key_frame_period"] = given.pop("key_frames")
    if "sources" in given:
        swm.data.merge(given.pop("sources"), out, progress=False, **given)
    elif "{}" in out.name:
        parts = [part.split("=") for part in given.pop("parts", ["train=0.9", "val=0.1"])]
        swm.data.split_files(given.pop("source"), out, parts={name: float(share) for name, share in parts}, progress=False, **given)
    else:
        swm.data.convert(given.pop("source"), out, progress=False, **given)


def content(path: Path) -> dict[str, bytes]:
    """The bytes of a file, or of all files of a folder."""
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
    return {str(file.relative_to(path)): file.read_bytes() for file in files}


@pytest.mark.parametrize("name", ["convert", "merge", "split"])
def test_a_copy_is_the_same_from_python_and_the_command(command: str, tmp_path: Path, recordings: Path, name: str) -> None:
    for index, request in enumerate(copies(f"{name}.json", recordings)):
        file = f"{index}-{{}}.h5" if name == "split" else f"{index}.h5"
        ours, theirs = (tmp_path / by / file for by in ("python", "command"))
        target = [str(theirs)] if name == "convert" else ["--out", str(theirs)]
        asked = words(request)
        place = next((at for at, word in enumerate(asked) if word.startswith("--")), len(asked))
        subprocess.run([command, name, *asked[:place], *target, *asked[place:], "--quiet"], check=True)
        copied(request, ours)
        made = sorted(path.name for path in theirs.parent.glob(f"{index}*") if path.suffix == ".h5")
        assert made and sorted(path.name for path in ours.parent.glob(f"{index}*") if path.suffix == ".h5") == made, request
        for part in made:
            assert content(ours.parent / part) == content(theirs.parent / part), (request, part)


def test_a_verification_is_the_same_from_python_and_the_command(command: str, recordings: Path) -> None:
    for request in copies("verify.json", recordings):
        told = subprocess.run([command, "verify", *words(request), "--json"], check=True, capture_output=True, text=True)
        given = {name: value for name, value in request.items() if name != "dataset"}
        assert swm.data.verify(request["dataset"], progress=False, **given) == json.loads(told.stdout)


def test_what_is_found_in_datasets_is_the_same_from_python_and_the_command(command: str, recordings: Path) -> None:
    asked: dict[str, Any] = {"replay": swm.replay, "diff": swm.data.diff, "inspect": swm.data.inspect, "stats": swm.data.stats}
    for name, found in asked.items():
        for request in copies(f"{name}.json", recordings):
            printed = subprocess.run([command, name, *words(request), "--json", "--quiet"], check=False, capture_output=True, text=True)
            given = {NAMES.get(setting, setting): value for setting, value in request.items()}
            data = [given.pop(setting) for setting in ("dataset", "first", "second") if setting in given]
            bar = {} if name in ("inspect", "stats") else {"progress": False}
            assert found(*data, **bar, **given) == json.loads(printed.stdout), request


def test_images_of_a_dataset_are_the_same_from_python_and_the_command(command: str, tmp_path: Path, recordings: Path) -> None:
    for index, request in enumerate(copies("preview.json", recordings)):
        ours, theirs = tmp_path / f"python-{index}.png", tmp_path / f"command-{index}.png"
        subprocess.run([command, "preview", *words(request), "--out", theirs, "--quiet"], check=True)
        given = dict(request)
        if size := given.pop("image_size", None):
            given["image_size"] = (size["height"], size["width"])
        made = swm.data.preview(given.pop("dataset"), ours, progress=False, **given)
        assert made["episodes"] and ours.read_bytes() == theirs.read_bytes(), request


def test_measures_are_the_same_from_python_and_the_command(command: str) -> None:
    for request in json.loads((TABLES / "measure.json").read_text()):
        told = subprocess.run([command, "quality", *words(request), "--json", "--quiet"], check=True, capture_output=True, text=True)
        assert swm.measure(**arguments(request), progress=False) == json.loads(told.stdout), request


def test_a_trace_is_the_same_from_python_and_the_command(command: str, tmp_path: Path) -> None:
    for index, table in enumerate(json.loads((TABLES / "plan.json").read_text())):
        ours, theirs = tmp_path / f"python-{index}", tmp_path / f"command-{index}"
        request = {"env": "swm/PushT-v1", "video_format": "gif", **table}
        subprocess.run([command, "plan", *words(request), "--trace", theirs, "--quiet"], check=True, stdout=subprocess.DEVNULL)
        planned = swm.plan(**arguments(request), trace=ours, progress=False)
        assert (ours / "trace.jsonl").read_bytes() == (theirs / "trace.jsonl").read_bytes(), request
        assert planned["plans"] and Path(planned["files"][0]) == ours / "index.html"


def test_images_are_the_same_from_python_and_the_command(command: str, tmp_path: Path) -> None:
    for index, request in enumerate(json.loads((TABLES / "render.json").read_text())):
        for end in ("png", "gif"):
            ours, theirs = tmp_path / f"python-{index}.{end}", tmp_path / f"command-{index}.{end}"
            subprocess.run([command, "render", *words(request), "--out", theirs, "--quiet"], check=True)
            size = request["image_size"]
            made = swm.render(ours, **arguments(request))
            assert (made["height"], made["width"]) == (size["height"], size["width"])
            assert ours.read_bytes() == theirs.read_bytes(), request


@pytest.mark.skipif(not _swm.HAS_TRAINING, reason="this build has no training")
def test_a_run_is_the_same_from_python_and_the_command(tmp_path: Path) -> None:
    data = tmp_path / "a.h5"
    command = [sys.executable, "-m", "stable_worldmodel_rs", "--quiet"]
    collect = "collect swm/TwoRoom-v2 --policy random --episodes 6 --max-steps 30 --image-size 64x64 --out"
    subprocess.run([*command, *collect.split(), data], check=True)
    for index, request in enumerate(json.loads((TABLES / "train.json").read_text().replace("DATA", str(data)))):
        ours, theirs = tmp_path / f"python-{index}", tmp_path / f"command-{index}"
        subprocess.run([*command, "train", *words(request), "--out", theirs], check=True, stdout=subprocess.DEVNULL)
        names = {"set": "settings", "env_option": "env_options"}
        swm.train(out=ours, progress=False, **{names.get(name, name): value for name, value in request.items()})
        files = ["config.json", *(f"checkpoints/{path.name}" for path in sorted((theirs / "checkpoints").iterdir()))]
        assert len(files) > 3
        for file in files:
            assert (ours / file).read_bytes() == (theirs / file).read_bytes(), (request, file)


def test_python_words_a_remedy_of_a_measure_a_plan_and_an_image(tmp_path: Path) -> None:
    with pytest.raises(swm.SwmError, match="rows=3: use more than the horizon, which is 10"):
        swm.measure("swm/PushT-v1", rows=3)
    with pytest.raises(swm.SwmError, match="pair=1: is a pair of a manifest; give manifest"):
        swm.plan("cem", "swm/PushT-v1", pair=1)
    with pytest.raises(swm.SwmError, match="episodes=0: nothing is planned for"):
        swm.plan("cem", "swm/PushT-v1", episodes=0)
    with pytest.raises(swm.SwmError, match="a.bmp"):
        swm.render(tmp_path / "a.bmp", "swm/PushT-v1")
    assert not list(tmp_path.iterdir())


def test_python_words_a_remedy_of_a_preview_a_replay_and_a_comparison(tmp_path: Path, recordings: Path) -> None:
    a = recordings / "a.h5"
    with pytest.raises(swm.SwmError, match="episodes=\"7\": there is no episode 7; the dataset holds 3"):
        swm.data.preview(a, tmp_path / "a.png", [7], progress=False)
    with pytest.raises(swm.SwmError, match="did you mean `pixels`"):
        swm.data.preview(a, tmp_path / "a.png", column="pixel", progress=False)
    with pytest.raises(ValueError, match="tolerance=nan: a number is NaN"):
        swm.replay(a, tolerance=float("nan"), progress=False)
    with pytest.raises(swm.SwmError, match="columns are chosen already; leave out columns, or leave out ignore"):
        swm.data.diff(a, a, columns=["action"], ignore=["pixels"], progress=False)
    with pytest.raises(swm.SwmError, match="did you mean `action`"):
        swm.data.stats(a, ["acton"])
    with pytest.raises(swm.SwmError, match="quantiles=2.0: each is a number from 0 to 1"):
        swm.data.stats(a, quantiles=[2.0])
    with pytest.raises(TypeError, match="is a text; give a list"):
        swm.data.stats(a, "action")
    with pytest.raises(FileNotFoundError, match="none.h5"):
        swm.data.inspect(tmp_path / "none.h5")
    assert not list(tmp_path.iterdir())


def test_python_words_a_remedy_of_a_copy(tmp_path: Path, recordings: Path) -> None:
    a, b = recordings / "a.h5", recordings / "b.h5"
    with pytest.raises(swm.SwmError, match="b.h5 exists and is another dataset: .*; give another dest, or mode=\"overwrite\" to"):
        swm.data.convert(a, b, progress=False)
    with pytest.raises(swm.SwmError, match=r"give image_size=\(20, 20\) for images of one size"):
        swm.data.merge([a, recordings / "small.h5"], tmp_path / "c.h5", progress=False)
    with pytest.raises(swm.SwmError, match="write `{}` where the name of the part belongs"):
        swm.data.split_files(a, tmp_path / "c.h5", progress=False)
    with pytest.raises(swm.SwmError, match="dry_run=True: is about a repair, and none is asked for; give fix=True, or leave out dry_run"):
        swm.data.verify(a, dry_run=True, progress=False)
    assert not list(tmp_path.iterdir())


def test_python_words_a_remedy_of_a_recording(tmp_path: Path) -> None:
    out = tmp_path / "a.h5"
    request = {"env": "swm/PushT-v1", "episodes": 2, "max_steps": 3, "image_size": None}
    recorded(request, out)
    with pytest.raises(swm.SwmError, match="exists and holds 2 episodes; give mode=\"append\" to record 2 more, or"):
        recorded(request, out)


def test_python_words_a_remedy_as_keyword_arguments(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    out = tmp_path / "task.toml"

    def refused(**given: Any) -> str:
        with pytest.raises(swm.SwmError) as error:
            swm.make_manifest(out, "swm/PushT-v1", **given)
        assert not out.exists()
        return str(error.value)

    assert refused(budget=0) == "budget=0: no action is allowed; use 1 or more"
    assert refused(distractors=["noise"]) == (
        'distractors=["noise"]: changes images, and there are none; give image_shape=(64, 64)'
    )
    assert refused(pairs=[(0, 1, 2)]).endswith("give dataset, or leave out pairs")
    assert "`variation_space` of the environment lists them" in refused(variation=["agent.colr"])
    swm.make_manifest(out, "swm/PushT-v1", 2, variation=["agent.color"])
    assert 'give variation=["+agent.color"] to sample them, too' in caplog.text
