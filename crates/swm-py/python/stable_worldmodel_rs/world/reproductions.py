"""Published results, repeated and compared with what was reported."""

from __future__ import annotations

import json
from collections.abc import Sequence
from os import PathLike
from typing import Any, cast

from .._access import access_checked
from .._arguments import home_path, kind_of
from .._core import core as _swm
from .._requests import asked
from .manifests import AnyPath


def recipes() -> list[dict[str, Any]]:
    """What `reproduce` can repeat: of each result ``name``, ``about``, ``env``, ``checkpoint``, ``dataset``, ``policy`` (the planner's settings),
    and ``figures``, the reported success rates in percent, each with its protocol and source."""
    found: list[dict[str, Any]] = json.loads(_swm.recipes())
    for recipe in found:
        recipe["figures"] = recipe.pop("figure")
    return found


@access_checked
def reproduce(
    name: AnyPath,
    out: AnyPath | None = None,
    *,
    folder: AnyPath | None = None,
    checkpoint: AnyPath | None = None,
    dataset: AnyPath | None = None,
    figures: Sequence[str] | str = (),
    pairs: int | None = None,
    device: str = "cpu",
    num_envs: int = 8,
    threads: int | None = None,
    fetch: bool = False,
    again: bool = False,
    check_only: bool = False,
    progress: bool = True,
) -> dict[str, Any]:
    """Repeat a published result: import its checkpoint, evaluate it by the reported protocol, and compare.

    Nothing is fetched without ``fetch``. What was evaluated already is not evaluated again, so that the same call continues an interrupted one.

    Args:
        name: A name of `recipes`, such as ``"lewm-pusht"``; or a file that ends with ``.toml``, a recipe of the same form.
        out: The folder for the run, the manifests, the receipts and the table.
        folder: Where downloads lie; None: ``$STABLEWM_HOME``, or ``~/.stable_worldmodel``.
        checkpoint: Its folder or file, or ``"hf:USER/REPO"`` in a local cache; None: looked for.
        dataset: Its file; None: looked for.
        figures: Only these of the reported figures, by name.
        pairs: Only the first pairs of each manifest.
        device: Of the networks: ``"cpu"``, ``"cuda"``, ``"cuda:1"`` …
        num_envs: Environments side by side; results do not depend on it.
        threads: None: one per core; results do not depend on it.
        fetch: Fetch what is missing into ``folder``, by the programs ``hf`` and ``curl``.
        again: Evaluate again what ``out`` holds already.
        check_only: Look for what is needed, and do nothing.
        progress: Whether to show a bar for each evaluation.

    Returns:
        ``rows``, one of each figure: ``figure``, ``protocol``, ``ours`` (``success_rate`` in percent, its 95 % interval ``ci95``, ``episodes``),
        ``reported``, ``difference`` in percentage points, ``is_within`` (the reported rate lies in our interval), ``source``, and
        ``repetitions``, each with its ``receipt``. Beside them ``run``, the imported model for ``"mpc:RUN"``; ``file``, the table as a file;
        and ``needs``: what was needed, where it was ``found`` or ``looked_in``, and the words of the command that would ``fetch`` it.

    Raises:
        SwmError: Something must be downloaded: the message names each file, where it was looked for, and the command that fetches it. Or a
            file is another one than the recipe's.

    Example:
        >>> table = swm.reproduce("lewm-pusht", "lewm-pusht", figures=["moderate"], pairs=10)  # doctest: +SKIP
    """
    if not isinstance(cast("Any", name), (str, PathLike)):
        raise TypeError(f"name is {kind_of(name)}; give a name, such as 'lewm-pusht': recipes() lists them; or the path of a recipe")
    is_file = str(name).endswith(".toml")
    request = {
        "name": "" if is_file else str(name),
        "recipe": home_path("name", name) if is_file else None,
        "folder": home_path("folder", folder),
        "checkpoint": str(checkpoint) if str(checkpoint).startswith("hf:") else home_path("checkpoint", checkpoint),
        "dataset": home_path("dataset", dataset),
        "figure": [figures] if isinstance(figures, str) else list(figures),
        "pairs": pairs,
        "device": str(device),
        "num_envs": num_envs,
        "threads": threads,
        "out": home_path("out", out) or "",
        "fetch": fetch,
        "again": again,
        "check_only": check_only,
    }
    return dict(asked("reproduce", request, progress))
