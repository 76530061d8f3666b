"""Results that are handed on: a folder that others verify without the dataset, and pages of such folders."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any

from .._access import access_checked
from .._arguments import path_of, target_path
from .._requests import asked
from .manifests import AnyPath, existing


@access_checked
def bundle(
    result: AnyPath,
    out: AnyPath,
    *,
    license: str | None = None,
    reported: float | None = None,
    source: str | None = None,
) -> dict[str, Any]:
    """Put a result and all it takes to repeat it into one folder: ``swm.verify(folder)`` repeats it in any installation.

    The folder has the manifest with its starts and goals, the receipt, the files of the model with a card, versions, a README and the
    SHA-256 of every file. It is written as a whole or not at all.

    Args:
        result: The folder ``out`` of `evaluate`, or the receipt in it.
        out: The folder to write; it must not be there.
        license: License of the model by its SPDX identifier, such as ``"mit"``.
        reported: A published success rate of the same policy on the same task, in percent: `board` shows both.
        source: Where that is published.

    Returns:
        ``bundle`` (its path), ``files``, ``bytes``, ``hash`` (the name of its content), ``is_foreign``: the policy is an object of Python,
        which `verify` has to be given.

    Raises:
        SwmError: ``out`` is there; a file of the model is gone or was changed since; the receipt was edited.
    """
    request = {
        "result": existing(path_of("result", result, "the folder `out` of evaluate, or the receipt in it"), "receipt"),
        "out": str(target_path("out", out)),
        "license": license,
        "reported": reported,
        "source": source,
    }
    return dict(asked("bundle", request))


@access_checked
def board(
    bundles: Sequence[AnyPath] | AnyPath,
    out: AnyPath,
    *,
    title: str = "Results",
    rerun: bool = False,
    oracle: bool = False,
    num_envs: int = 8,
    threads: int | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Verify bundles, and write them as one static page, sorted by manifest: intervals, paired differences, reproduced beside reported.

    Args:
        bundles: Folders that `bundle` made.
        out: The folder to write: ``index.html`` and ``board.json``. An earlier board is replaced.
        title: What the page is called.
        rerun: Run every bundle again, beside comparing the hashes of its files.
        oracle: With ``rerun``: the oracles, too.
        num_envs: With ``rerun``: environments side by side.
        threads: With ``rerun``: threads; None: one per core.
        progress: With ``rerun``: whether to show a bar for each bundle.

    Returns:
        What is in ``board.json``, and ``page``, its path. Of what was run again, ``rerun`` has ``equal`` and ``differences``.

    Raises:
        SwmError: A bundle has a changed byte (the message names the file), or ``out`` holds something else.
    """
    folders = [bundles] if isinstance(bundles, (str, PathLike)) else list(bundles)
    request = {
        "bundles": [existing(folder, "bundle") for folder in folders],
        "out": str(target_path("out", out)),
        "title": title,
        "rerun": rerun,
        "oracle": oracle,
        "num_envs": num_envs,
        "threads": threads,
    }
    return dict(asked("board", request, progress))
