"""Sinks: what each tracker's library is told, and no more. A library is imported when its sink is opened."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from ._values import flat

STATE = "track.json"
# What trackers group runs by.
PROJECT = "stable-worldmodel"
# What MLflow keeps of a parameter.
_LONGEST_PARAM = 500


@dataclass(frozen=True)
class Run:
    """What all trackers are told of a run."""

    folder: Path
    project: str
    name: str
    config: Mapping[str, Any]
    # The step that it goes on from; None: it is new.
    after: int | None

    def known(self, tracker: str) -> str | None:
        """The id that a tracker gave the run that is gone on with."""
        file = self.folder / STATE
        if self.after is None or not file.is_file():
            return None
        found: dict[str, str] = json.loads(file.read_text(encoding="utf-8"))
        return found.get(tracker)

    def keep(self, tracker: str, id: str) -> None:
        """Remember the id that a tracker gave the run."""
        file = self.folder / STATE
        found: dict[str, str] = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
        draft = file.with_name(f".{STATE}.{os.getpid()}")
        draft.write_text(json.dumps({**found, tracker: id}, indent=2) + "\n", encoding="utf-8")
        os.replace(draft, file)


class Sink(Protocol):
    """Where values go."""

    def log(self, step: int, values: Mapping[str, float]) -> None:
        """Take numbers of a step."""
        ...

    def document(self, name: str, path: Path, step: int) -> None:
        """Take a file that belongs to a step: a receipt."""
        ...

    def video(self, name: str, path: Path, step: int) -> None:
        """Take a video that belongs to a step."""
        ...

    def finish(self) -> None:
        """End the run."""
        ...


# What a sink imports.
_MODULES = {"trackio": "trackio", "wandb": "wandb", "mlflow": "mlflow", "tensorboard": "tensorboard.summary"}


def library(tracker: str) -> Any:
    """The module that a tracker needs.

    Raises:
        ImportError: It is not installed.
        ValueError: There is no tracker of that name.
    """
    if tracker not in _MODULES:
        raise ValueError(f"there is no tracker {tracker!r}; use {', '.join(_MODULES)}")
    try:
        return import_module(_MODULES[tracker])
    except ImportError as error:
        raise ImportError(f"tracking by {tracker} needs the package {tracker}; `pip install {tracker}`") from error


class Trackio:
    """Trackio: a database of this machine (``TRACKIO_DIR``), unless ``TRACKIO_SPACE_ID`` names a Space. NaN and infinities stay."""

    def __init__(self, run: Run) -> None:
        self._module = library("trackio")
        resume = "never" if run.after is None else "allow"
        self._run = self._module.init(project=run.project, name=run.name, config=dict(run.config), resume=resume)

    def log(self, step: int, values: Mapping[str, float]) -> None:
        """As of `Sink`."""
        self._run.log(dict(values), step=step)

    def document(self, name: str, path: Path, step: int) -> None:
        """As of `Sink`: an artifact, in versions of Trackio that have them."""
        if hasattr(self._module, "Artifact"):
            artifact = self._module.Artifact(_slug(name), type="evaluation", metadata={"step": step})
            artifact.add_file(str(path))
            self._run.log_artifact(artifact)

    def video(self, name: str, path: Path, step: int) -> None:
        """As of `Sink`."""
        self._run.log({name: self._module.Video(str(path), caption=path.name)}, step=step)

    def finish(self) -> None:
        """As of `Sink`."""
        self._run.finish()


class Wandb:
    """Weights & Biases, offline unless ``WANDB_MODE`` says otherwise; ``wandb sync`` sends it later. NaN and infinities stay."""

    def __init__(self, run: Run) -> None:
        self._module = library("wandb")
        known = run.known("wandb")
        self._run = self._module.init(
            project=run.project,
            name=run.name,
            dir=str(run.folder),
            config=dict(run.config),
            mode=os.environ.get("WANDB_MODE", "offline"),
            **({} if known is None else {"id": known, "resume": "allow"}),
        )
        run.keep("wandb", str(self._run.id))

    def log(self, step: int, values: Mapping[str, float]) -> None:
        """As of `Sink`."""
        self._run.log(dict(values), step=step)

    def document(self, name: str, path: Path, step: int) -> None:
        """As of `Sink`."""
        artifact = self._module.Artifact(f"{_slug(name)}-{self._run.id}", type="evaluation", metadata={"step": step})
        artifact.add_file(str(path))
        self._run.log_artifact(artifact)

    def video(self, name: str, path: Path, step: int) -> None:
        """As of `Sink`."""
        self._run.log({name: self._module.Video(str(path))}, step=step)

    def finish(self) -> None:
        """As of `Sink`."""
        self._run.finish()


class Mlflow:
    """MLflow: ``mlflow.db`` in the run's folder, unless ``MLFLOW_TRACKING_URI`` names another store. NaN stays; an infinity becomes the
    largest number in a database. Characters that its names cannot have become ``_``."""

    def __init__(self, run: Run) -> None:
        module = library("mlflow")
        uri, artifacts = os.environ.get("MLFLOW_TRACKING_URI"), None
        if uri is None:
            where = run.folder.resolve()
            uri, artifacts = f"sqlite:///{where / 'mlflow.db'}", (where / "mlartifacts").as_uri()
        self._client: Any = module.MlflowClient(tracking_uri=uri)
        found = self._client.get_experiment_by_name(run.project)
        experiment = self._client.create_experiment(run.project, artifact_location=artifacts) if found is None else found.experiment_id
        known = run.known("mlflow")
        if known is not None:
            self._id = known
            self._client.update_run(known, status="RUNNING")
            return
        self._id = str(self._client.create_run(experiment, run_name=run.name).info.run_id)
        run.keep("mlflow", self._id)
        for name, value in run.config.items():
            self._client.log_param(self._id, _plain(name), str(value)[:_LONGEST_PARAM])

    def log(self, step: int, values: Mapping[str, float]) -> None:
        """As of `Sink`."""
        for name, value in values.items():
            self._client.log_metric(self._id, _plain(name), value, step=step)

    def document(self, name: str, path: Path, step: int) -> None:
        """As of `Sink`; the step is in the name of the file."""
        self._client.log_artifact(self._id, str(path), _plain(name))

    def video(self, name: str, path: Path, step: int) -> None:
        """As of `Sink`."""
        self._client.log_artifact(self._id, str(path), f"videos/{step}")

    def finish(self) -> None:
        """As of `Sink`."""
        self._client.set_terminated(self._id)


class Tensorboard:
    """TensorBoard: event files in ``tensorboard`` in the run's folder. NaN and infinities stay; it has neither documents nor videos."""

    def __init__(self, run: Run) -> None:
        module = library("tensorboard")
        self._writer: Any = module.Writer(str(run.folder / "tensorboard"))

    def log(self, step: int, values: Mapping[str, float]) -> None:
        """As of `Sink`."""
        for name, value in values.items():
            self._writer.add_scalar(name, value, step)
        self._writer.flush()

    def document(self, name: str, path: Path, step: int) -> None:
        """Nothing: the file stays where it is."""

    def video(self, name: str, path: Path, step: int) -> None:
        """Nothing: the file stays where it is."""

    def finish(self) -> None:
        """As of `Sink`."""
        self._writer.close()


SINKS: dict[str, Callable[[Run], Sink]] = {"trackio": Trackio, "wandb": Wandb, "mlflow": Mlflow, "tensorboard": Tensorboard}


def open_sink(name: str, run: Run) -> Sink:
    """The sink of a tracker."""
    if name not in SINKS:
        raise ValueError(f"there is no tracker {name!r}; use {', '.join(SINKS)}")
    return SINKS[name](run)


def open_sinks(names: Sequence[str], folder: Path, project: str, name: str | None, after: int | None) -> list[Sink]:
    """The sinks of trackers for a run of a training in a folder, with the settings in its ``config.json``."""
    file = folder / "config.json"
    config = flat(json.loads(file.read_text(encoding="utf-8"))) if file.is_file() else {}
    run = Run(folder, project, name or folder.resolve().name, config, after)
    found: list[Sink] = []
    try:
        for one in names:
            found.append(open_sink(one, run))
    except BaseException:
        for sink in found:
            sink.finish()
        raise
    return found


def _slug(name: str) -> str:
    """A name of letters, digits, `-`, `_` and `.`."""
    return re.sub(r"[^\w.-]", "-", name)


def _plain(name: str) -> str:
    """A name as MLflow takes it."""
    return re.sub(r"[^\w.:/ -]", "_", name)
