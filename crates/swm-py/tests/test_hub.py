"""Models and datasets as repositories: folders with cards, and their way to a Hub on this machine and back."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from hub_stub import hub_at_work

import stable_worldmodel_rs as swm

FIELD = Path(__file__).parents[3] / "tests" / "golden" / "field"
needs_hub = pytest.mark.skipif(find_spec("huggingface_hub") is None, reason="huggingface_hub is not installed")


def a_run(folder: Path) -> Path:
    """A folder as `swm train` leaves it."""
    run = folder / "lewm"
    (run / "checkpoints").mkdir(parents=True)
    (run / "config.json").write_text(json.dumps({"version": 1, "model_config": {}, "data": {"env": "swm/TwoRoom-v2"}}))
    for name, size in (("step-1.safetensors", 5000), ("step-1.training.safetensors", 20), ("step-1.json", 40)):
        (run / "checkpoints" / name).write_bytes(bytes(size))
    for name in ("lock", "events.out.tfevents.1.a", "metrics.jsonl"):
        (run / name).write_text("{}\n")
    return run


def metadata(card: Path) -> dict[str, list[str]]:
    """The top level of a card's metadata: lines by name."""
    _, text, _ = card.read_text().split("---\n", 2)
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line[0] not in " -":
            found[line.split(":")[0]] = []
        found[list(found)[-1]].append(line)
    return found


def test_a_model_has_a_card_and_no_more_than_it_needs(tmp_path: Path) -> None:
    swm.make_manifest(tmp_path / "task.toml", "swm/PushT-v1", episodes=2, budget=4)
    receipt = swm.evaluate(tmp_path / "task.toml", "random", tmp_path / "result", references=[], progress=False)
    folder = swm.hub.save_model(a_run(tmp_path), tmp_path / "hub", license="mit", tags=["lewm", "lewm"], results=[tmp_path / "result"])
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    assert files == [
        "README.md",
        "checkpoints/step-1.json",
        "checkpoints/step-1.safetensors",
        "config.json",
        "metrics.jsonl",
        "results/receipt-0.json",
    ]
    card = metadata(folder / "README.md")
    assert card["license"] == ['license: "mit"'] and card["library_name"] == ['library_name: "stable-worldmodel-rs"']
    assert card["tags"][1:] == ['- "world-model"', '- "planning"', '- "swm/PushT-v1"', '- "lewm"']
    text = (folder / "README.md").read_text()
    low, high = receipt.interval
    assert f"{receipt.success_rate:.1f} % ({low:.1f} to {high:.1f})" in text and "mpc:{folder}" in text
    if find_spec("yaml"):
        import yaml  # type: ignore[import-untyped]

        parsed = yaml.safe_load(text.split("---\n", 2)[1])
        assert parsed["model-index"][0]["results"][0]["metrics"][0]["value"] == receipt.success_rate


def a_receipt_of(run: Path, tmp_path: Path) -> dict[str, Any]:
    """A receipt as `swm eval --policy mpc:RUN` writes it on this machine."""
    swm.make_manifest(tmp_path / "task.toml", "swm/PushT-v1", episodes=2, budget=4)
    receipt = dict(swm.evaluate(tmp_path / "task.toml", "random", references=["no_op"], progress=False))
    files = [run / "config.json", run / "checkpoints" / "step-1.safetensors"]
    receipt["candidate"] = {**receipt["candidate"], "policy": {"name": "mpc", "positional": [str(run)], "named": {"samples": 8}}}
    receipt["files"] = {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    return receipt


def test_receipts_of_a_model_have_paths_in_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = a_run(tmp_path)
    receipt = a_receipt_of(run, tmp_path)
    folder = swm.hub.save_model(run, tmp_path / "hub", license="mit", results=[receipt])
    text = (folder / "results" / "receipt-0.json").read_text()
    assert str(tmp_path) not in text
    written = json.loads(text)
    assert written["candidate"]["policy"] == {"name": "mpc", "positional": [".."], "named": {"samples": 8}} and written["paths"] == [".."]
    assert written["files"] == {f"../{Path(path).relative_to(run).as_posix()}": hash for path, hash in receipt["files"].items()}
    # Wherever the folder is, and from wherever it is opened.
    shutil.move(folder, tmp_path / "elsewhere")
    monkeypatch.chdir(tmp_path)
    for path, root in [(tmp_path / "elsewhere" / "results" / "receipt-0.json", tmp_path / "elsewhere"), (Path("elsewhere/results/receipt-0.json"), Path("elsewhere"))]:
        opened = swm.read_receipt(path)
        assert opened["candidate"]["policy"]["positional"] == [str(root)] and "paths" not in opened
        assert all(Path(name).is_file() for name in opened["files"])
    # Receipts with paths of this machine open as before.
    (tmp_path / "old.json").write_text(json.dumps(receipt))
    assert swm.read_receipt(tmp_path / "old.json")["files"] == receipt["files"]
    written["files"] = {f"../../{name}": hash for name, hash in written["files"].items()}
    (tmp_path / "elsewhere" / "results" / "receipt-0.json").write_text(json.dumps(written))
    with pytest.raises(swm.SwmError, match="leads out of the folder"):
        swm.read_receipt(tmp_path / "elsewhere" / "results" / "receipt-0.json")


def test_a_receipt_of_another_model_is_refused(tmp_path: Path) -> None:
    run = a_run(tmp_path)
    receipt = a_receipt_of(run, tmp_path)
    (run / "checkpoints" / "step-1.safetensors").write_bytes(b"trained further")
    with pytest.raises(ValueError, match=r"step-1\.safetensors, which is not in the folder, or was changed since"):
        swm.hub.save_model(run, tmp_path / "hub", license="mit", results=[receipt])
    assert not (tmp_path / "hub").exists()
    # Of a policy in Python, files that are no part of the model keep their names and hashes.
    receipt["candidate"]["policy"] = {"name": "Mine", "named": {"gain": 1}}
    written = json.loads((swm.hub.save_model(run, tmp_path / "hub", license="mit", results=[receipt]) / "results/receipt-0.json").read_text())
    assert sorted(written["files"]) == ["../config.json", "step-1.safetensors"]


def test_a_dataset_has_a_card_and_opens_again(pusht_file: Path, tmp_path: Path) -> None:
    folder = swm.hub.save_dataset(pusht_file, tmp_path / "hub", license="cc-by-4.0")
    card = metadata(folder / "README.md")
    assert card["task_categories"] == ["task_categories:", '- "robotics"'] and card["size_categories"][1] == '- "n<1K"'
    assert card["configs"] == [
        "configs:",
        '- config_name: "default"',
        "  data_files:",
        '  - split: "train"',
        '    path: "pusht.h5"',
    ]
    dataset = swm.hub.from_pretrained(folder, repo_type="dataset", num_steps=2)
    assert len(dataset.lengths) == 4 and dataset[0]["pixels"].shape == (2, 3, 32, 32)


@pytest.mark.parametrize("format", ["folder", "lerobot"])
def test_folders_of_datasets_open_beside_a_card(pusht_file: Path, tmp_path: Path, format: str) -> None:
    copied = tmp_path / "copied"
    swm.data.convert(pusht_file, copied, dest_format=format, progress=False)
    folder = swm.hub.save_dataset(copied, tmp_path / "hub", license="mit")
    assert len(swm.hub.from_pretrained(folder, repo_type="dataset").lengths) == 4


def test_a_store_of_zarr_keeps_what_describes_its_arrays(tmp_path: Path) -> None:
    folder = swm.hub.save_dataset(FIELD / "pusht_cchi_v7_replay.zarr", tmp_path / "hub", license="mit")
    assert swm.hub.from_pretrained(folder, repo_type="dataset").lengths.tolist() == [9, 6, 8]


def test_wrong_folders_and_names_are_told(tmp_path: Path) -> None:
    run = a_run(tmp_path)
    with pytest.raises(ValueError, match="give an SPDX identifier"):
        swm.hub.save_model(run, tmp_path / "hub", license=" ")
    assert [path.name for path in tmp_path.iterdir()] == ["lewm"], "a draft is left"
    with pytest.raises(FileExistsError, match="exists; name a folder that is not there yet"):
        swm.hub.save_model(run, run, license="mit")
    with pytest.raises(ValueError, match="holds no model"):
        swm.hub.save_model(tmp_path, tmp_path / "hub", license="mit")
    with pytest.raises(FileNotFoundError, match="there is no dataset"):
        swm.hub.save_dataset(tmp_path / "none.h5", tmp_path / "hub", license="mit")
    with pytest.raises(ValueError, match="give 'user/repository'"):
        swm.hub.push_to_hub(run, "lewm")
    with pytest.raises(ValueError, match="use 'model' or 'dataset'"):
        swm.hub.push_to_hub(run, "me/lewm", repo_type="space")
    with pytest.raises(ValueError, match=r"has no README\.md whose metadata has a license"):
        swm.hub.push_to_hub(run, "me/lewm")
    with pytest.raises(FileNotFoundError, match=r"swm\.hub\.download\('me/nothing', repo_type='dataset'\)"):
        swm.hub.from_pretrained("me/nothing", repo_type="dataset")


def test_an_upload_without_the_library_says_how_to_install_it(tmp_path: Path, run_python: Any) -> None:
    folder = swm.hub.save_model(a_run(tmp_path), tmp_path / "hub", license="mit")
    code = f"import sys; sys.modules['huggingface_hub'] = None\nimport stable_worldmodel_rs as swm\nswm.hub.push_to_hub({str(folder)!r}, 'me/lewm')"
    done = run_python(code)
    assert "push_to_hub needs huggingface_hub; `pip install huggingface_hub`" in done.stderr


@needs_hub
def test_a_model_goes_to_the_hub_and_goes_on_where_it_stopped(tmp_path: Path, run_python: Any) -> None:
    folder = swm.hub.save_model(a_run(tmp_path), tmp_path / "hub", license="mit")
    # More than one commit takes.
    for index in range(60):
        (folder / f"part-{index:02}.json").write_text(str(index))
    with hub_at_work() as hub:
        push = f"import stable_worldmodel_rs as swm; print(swm.hub.push_to_hub({str(folder)!r}, 'me/lewm'))"
        environment = {**endpoint(hub.address, tmp_path), "HF_TOKEN": "hf_secret"}
        hub.left = 1
        broken = run_python(push, **environment)
        assert broken.returncode != 0 and len(hub.commits) == 1 and "README.md" not in hub.repos["models/me/lewm"]
        first, hub.left = set(hub.sent), None
        done = run_python(push, **environment)
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip() == f"{hub.address}/me/lewm" and "Bearer hf_secret" in hub.tokens
        assert len(hub.sent) == len(set(hub.sent)) and first < set(hub.sent), "no file is sent twice"
        assert hub.commits[-1] == ["README.md"], "the card comes last"
        files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        assert hub.repos["models/me/lewm"] == files
        count = len(hub.commits)
        assert run_python(push, **environment).returncode == 0 and len(hub.commits) == count, "nothing is left to send"
        (folder / "config.json").write_text("{}")
        assert run_python(push, **environment).returncode == 0 and hub.commits[-1] == ["config.json"]


@needs_hub
def test_a_published_model_and_a_dataset_come_back_from_the_hub(tmp_path: Path, pusht_file: Path, run_python: Any) -> None:
    torch = pytest.importorskip("torch")
    from test_wm import config_of  # type: ignore[import-not-found]

    config = config_of("lewm_transformers5")
    model = swm.wm.from_config(config)
    swm.save_pretrained(model, tmp_path / "model", config)
    swm.hub.save_model(tmp_path / "model", tmp_path / "model-hub", license="mit")
    swm.hub.save_dataset(pusht_file, tmp_path / "data-hub", license="mit")
    with hub_at_work() as hub:
        code = f"""
import torch, stable_worldmodel_rs as swm
swm.hub.push_to_hub({str(tmp_path / "model-hub")!r}, "me/model")
swm.hub.push_to_hub({str(tmp_path / "data-hub")!r}, "me/data", repo_type="dataset")
for kind, name in (("model", "me/model"), ("dataset", "me/data")):
    try:
        swm.hub.from_pretrained(name, repo_type=kind)
    except FileNotFoundError:
        pass
    else:
        raise AssertionError("it was fetched unasked")
    swm.hub.download(name, repo_type=kind)
torch.save(swm.hub.from_pretrained("me/model").state_dict(), {str(tmp_path / "back.pt")!r})
assert len(swm.hub.from_pretrained("me/data", repo_type="dataset").lengths) == 4
"""
        done = run_python(code, **endpoint(hub.address, tmp_path), HF_TOKEN="hf_secret")
        assert done.returncode == 0, done.stderr
    back = torch.load(tmp_path / "back.pt", weights_only=True)
    assert all(torch.equal(value, back[name]) for name, value in model.state_dict().items())


@needs_hub
def test_a_dataset_comes_back_without_torch(tmp_path: Path, pusht_file: Path, run_python: Any) -> None:
    swm.hub.save_dataset(pusht_file, tmp_path / "data-hub", license="mit")
    with hub_at_work() as hub:
        code = f"""
import stable_worldmodel_rs as swm
swm.hub.push_to_hub({str(tmp_path / "data-hub")!r}, "me/data", repo_type="dataset")
folder = swm.hub.download("me/data", repo_type="dataset")
assert len(swm.hub.from_pretrained("me/data", repo_type="dataset").lengths) == 4
print(folder)
"""
        done = run_python(code, **endpoint(hub.address, tmp_path), HF_TOKEN="hf_secret")
        assert done.returncode == 0, done.stderr
    assert (Path(done.stdout.strip()) / "pusht.h5").read_bytes() == pusht_file.read_bytes()


def endpoint(address: str, folder: Path) -> dict[str, str]:
    """The environment of a program that takes this server for the Hub."""
    shutil.rmtree(folder / "home", ignore_errors=True)
    return {
        "HF_ENDPOINT": address,
        "HF_HOME": str(folder / "home"),
        "HF_HUB_DISABLE_XET": "1",
        "HF_HUB_DISABLE_TELEMETRY": "1",
        "STABLEWM_HOME": str(folder / "stablewm"),
        "NO_PROXY": "127.0.0.1",
        "PATH": os.environ.get("PATH", ""),
    }
