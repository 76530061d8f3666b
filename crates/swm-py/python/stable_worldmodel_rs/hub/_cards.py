"""Cards: ``README.md`` with the metadata that the Hub parses."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, cast

LIBRARY = "stable-worldmodel-rs"


def card(metadata: Mapping[str, Any], text: str) -> str:
    """A card: metadata as YAML between two lines of dashes, then text."""
    lines = [line for name, value in metadata.items() for line in _yaml(name, value, "")]
    return "---\n" + "\n".join(lines) + "\n---\n\n" + text.strip() + "\n"


def model_card(name: str, kind: str, license: str, tags: Sequence[str], env: str | None, results: Sequence[Mapping[str, Any]]) -> str:
    """The card of a model."""
    metadata: dict[str, Any] = {
        "license": license,
        "library_name": LIBRARY,
        "pipeline_tag": "robotics",
        "tags": _unique(["world-model", "planning", *([env] if env else []), *tags]),
    }
    if results:
        metadata["model-index"] = [{"name": name, "results": [_result(one) for one in results]}]
    lines = [f"# {name}", "", f"A model of stable-worldmodel for Rust: {kind}."]
    lines += ["", f"Environment: `{env}`."] if env else []
    if results:
        lines += ["", "| environment | tier | pairs | success | policy |", "|---|---|---|---|---|"]
        lines += [_row(one) for one in results]
    lines += ["", "## Use", "", "```python", "import stable_worldmodel_rs as swm", ""]
    lines += ['folder = swm.hub.download("USER/REPOSITORY")', *_use(kind), "```"]
    return card(metadata, "\n".join(lines))


def dataset_card(
    name: str, license: str, tags: Sequence[str], configs: Sequence[Mapping[str, Any]], about: Mapping[str, Any], columns: Sequence[tuple[str, str, str]]
) -> str:
    """The card of a dataset; ``columns`` are names, kinds and shapes."""
    env = about.get("environment")
    metadata = {
        "license": license,
        "library_name": LIBRARY,
        "pretty_name": name,
        "task_categories": ["robotics"],
        "size_categories": [_size(int(about["steps"]))],
        "tags": _unique(["world-model", *([str(env)] if env else []), *tags]),
        "configs": list(configs),
    }
    lines = [f"# {name}", "", "| | |", "|---|---|"]
    lines += [f"| {_cell(key)} | {_cell(value)} |" for key, value in about.items() if value is not None]
    lines += ["", "## Columns", "", "| column | type | shape of a step |", "|---|---|---|"]
    lines += [f"| `{_cell(column)}` | {kind} | {shape} |" for column, kind, shape in columns]
    lines += ["", "## Use", "", "```python", "import stable_worldmodel_rs as swm", ""]
    lines += ['swm.hub.download("USER/REPOSITORY", repo_type="dataset")', 'dataset = swm.hub.from_pretrained("USER/REPOSITORY", repo_type="dataset")', "```"]
    return card(metadata, "\n".join(lines))


def _use(kind: str) -> list[str]:
    if kind.startswith("a run"):
        return ['receipt = swm.evaluate("task.toml", f"mpc:{folder}")']
    if "ONNX" in kind:
        return ['receipt = swm.evaluate("task.toml", f"onnx:{folder}")']
    return ["model = swm.load_pretrained(folder)"]


def _result(receipt: Mapping[str, Any]) -> dict[str, Any]:
    manifest, summary = receipt["manifest"], receipt["summary"]
    low, high = summary["ci95"]
    task = f"{manifest['env']}, {manifest['tier']} tier, manifest {str(receipt['manifest_hash'])[:12]}"
    metric = {"type": "success_rate", "name": f"success in percent ({low:.1f} to {high:.1f})", "value": summary["success_rate"]}
    return {
        "task": {"type": "robotics", "name": manifest["env"]},
        "dataset": {"name": task, "type": manifest["env"]},
        "metrics": [metric],
    }


def _row(receipt: Mapping[str, Any]) -> str:
    manifest, summary = receipt["manifest"], receipt["summary"]
    low, high = summary["ci95"]
    rate = f"{summary['success_rate']:.1f} % ({low:.1f} to {high:.1f})"
    return f"| {manifest['env']} | {manifest['tier']} | {len(manifest['pairs'])} | {rate} | `{_cell(receipt['policy'])}` |"


def _size(rows: int) -> str:
    """The Hub's name for a number of rows."""
    bounds = [(1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"), (10_000_000, "1M<n<10M")]
    return next((name for bound, name in bounds if rows < bound), "10M<n<100M")


def _unique(names: Sequence[str]) -> list[str]:
    return list(dict.fromkeys(names))


def _cell(value: Any) -> str:
    return str(value).replace("\n", " ").replace("|", "/")


def _yaml(name: str, value: Any, indent: str) -> list[str]:
    """An entry of YAML in block form; texts as JSON has them, which YAML reads."""
    if isinstance(value, Mapping):
        entries = cast("Mapping[str, Any]", value).items()
        return [f"{indent}{name}:", *(line for key, one in entries for line in _yaml(key, one, indent + "  "))]
    if isinstance(value, list):
        return [f"{indent}{name}:", *(line for one in cast("list[Any]", value) for line in _item(one, indent))]
    return [f"{indent}{name}: {json.dumps(value, ensure_ascii=False)}"]


def _item(value: Any, indent: str) -> list[str]:
    if not isinstance(value, Mapping):
        return [f"{indent}- {json.dumps(value, ensure_ascii=False)}"]
    entries = cast("Mapping[str, Any]", value).items()
    lines = [line for key, one in entries for line in _yaml(key, one, indent + "  ")]
    return [f"{indent}- {lines[0].strip()}", *lines[1:]]
