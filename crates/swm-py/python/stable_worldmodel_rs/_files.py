"""Where MuJoCo's library and the models are: in the wheel, in an installed ``ogbench``, or in the data folder.

A wheel carries the library and the models of the control suite in ``_lib``, laid out as the data folder of the command.
Models of OGBench come with the package ``ogbench``, those of Meta-World with ``metaworld``; part of them has no license, so that no
wheel may carry them.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import sys
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from ._core import core as _swm

logger = logging.getLogger("stable_worldmodel_rs")
_LIB = Path(__file__).parent / "_lib"
_, _, (_, _, _OGBENCH, _METAWORLD) = _swm.files()
_FIX = (
    "reinstall the package from its wheel (`pip install --force-reinstall stable_worldmodel_rs-*.whl`); models of OGBench need "
    f"`pip install ogbench=={_OGBENCH}`, those of Meta-World `pip install metaworld=={_METAWORLD}`; those of Fetch are in no package: let SWM_HOME name a folder that "
    "`cargo xtask setup` filled"
)
# The package of the zoo.
_ZOO = "stable_worldmodel_zoo"
_ZOO_ADVICE = (
    "`pip install stable_worldmodel_zoo-*.whl`, the wheel of a release, or unpack the folder of a release into `zoo` of the data folder (SWM_HOME); "
    "`cargo xtask zoo NAME` makes one in a checkout"
)
# Where ogbench has its models, what the data folder calls that, and which of them are read (None: all).
_OGBENCH_PARTS: tuple[tuple[str, str, tuple[str, ...] | None], ...] = (
    ("manipspace/descriptions", "manipspace", None),
    ("locomaze/assets", "locomaze", ("ant.xml", "humanoid.xml", "point.xml")),
)
# The same of metaworld; the core compares its files.
_METAWORLD_PARTS: tuple[tuple[str, str, tuple[str, ...] | None], ...] = (("assets", "", None),)
_OGBENCH_SHA256 = "4f36c4a9b018d914867ce78bc4b023bfb8f21e11d5a90b0e195058926c3062c8"


# The data folder of the command, which `choose` may set aside.
_home: Path | None = None


def choose() -> None:
    """Tell the core where the files of the wheel are, unless an environment variable says otherwise."""
    global _home
    _, _home, (mujoco, *_) = _swm.files()
    library = next((_LIB / "mujoco" / mujoco).glob("*mujoco*"), None)
    chosen = os.environ.get("SWM_HOME")
    if library is not None and not chosen and not os.environ.get("SWM_MUJOCO_LIB"):
        _swm.set_files(library=str(library))
    folder = _LIB if not chosen and (_LIB / "dm_control").is_dir() else None
    python = sys.executable or None
    _swm.set_files(folder=None if folder is None else str(folder), fix=_FIX, python=python)
    _swm.set_zoo(_zoo_folders(), _ZOO_ADVICE)


def _zoo_folders() -> list[str]:
    """Where models of the zoo are: in the data folder of the command, and in the installed package of them, which is not imported."""
    folders = [] if _home is None else [_home / "zoo"]
    spec = find_spec(_ZOO)
    found = None if spec is None else spec.submodule_search_locations
    folders += [Path(place) / "models" for place in found or ()]
    return [str(folder) for folder in folders]


def offer_ogbench() -> None:
    """Make the models of OGBench known where the folder of the wheel lacks them.

    Called before the first environment of OGBench is made. They come from the data folder of the command, or from an
    installed ``ogbench``. The folder that joins them with what else is there lies in the user's cache and is made
    of links, or of copies where the system allows no links.
    """
    _, _, (_, _, ogbench, _) = _swm.files()
    _offer("ogbench", ogbench, _OGBENCH_PARTS)


def offer_metaworld() -> None:
    """As `offer_ogbench`, of Meta-World."""
    _, _, (_, _, _, metaworld) = _swm.files()
    _offer("metaworld", metaworld, _METAWORLD_PARTS)


def _offer(name: str, wanted: str, parts: tuple[tuple[str, str, tuple[str, ...] | None], ...]) -> None:
    _, folder, (_, _, ogbench, _) = _swm.files()
    if folder is None or (folder / name / wanted).is_dir():
        return
    own = None if _home is None else _home / name / wanted
    if own is not None and own.is_dir():
        sources = {place: own / place for _, place, _ in parts}
    else:
        package = _package(wanted, name)
        if package is None:
            return
        sources = {place: package / source for source, place, _ in parts}
    home = _cache() / f"models-{ogbench}"
    for place, source in sources.items():
        _link(source, home / name / wanted / place)
    for package in folder.iterdir() if folder.is_dir() and folder != home else ():
        if package.name != name and package.is_dir():
            for version_of in filter(Path.is_dir, package.iterdir()):
                _link(version_of, home / package.name / version_of.name)
    _swm.set_files(folder=str(home))
    logger.debug("the models of %s are those of %s", name, home)


def offer_if_fits() -> None:
    """As `offer_ogbench`, where it is not known whether the models are needed: why they cannot be taken stands in the error of who does."""
    reasons: list[str] = []
    for offer in (offer_ogbench, offer_metaworld):
        try:
            offer()
        except _swm.EnvError as error:
            reasons.append(f" ({error})")
    if reasons:
        _swm.set_files(fix=_FIX + "".join(reasons))


def _package(wanted: str, name: str = "ogbench") -> Path | None:
    """The folder of the installed package, checked; None if there is none."""
    try:
        installed = version(name)
    except PackageNotFoundError:
        return None
    spec = find_spec(name)
    if installed != wanted or spec is None or not spec.submodule_search_locations:
        raise _swm.EnvError(
            f"{name} {installed} is installed, and its models differ from those of {wanted}; "
            f"run `pip install {name}=={wanted}`"
        )
    package = Path(next(iter(spec.submodule_search_locations)))
    if name == "ogbench":
        _check(package)
    return package


def _check(package: Path) -> None:
    """Refuse models that are not those of the published package: other models are other dynamics."""
    digest = hashlib.sha256()
    for source, place, names in _OGBENCH_PARTS:
        folder = package / source
        for name in names or sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.xml")):
            digest.update(f"{place}/{name}\n".encode())
            if (folder / name).is_file():
                digest.update((folder / name).read_bytes())
    if digest.hexdigest() != _OGBENCH_SHA256:
        raise _swm.EnvError(
            f"the models in {package} are not those that were published; "
            "run `pip install --force-reinstall --no-deps ogbench==1.2.2`"
        )


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or (
        os.environ.get("LOCALAPPDATA") if sys.platform == "win32" else os.path.join("~", ".cache")
    )
    return Path(base or "~").expanduser() / "stable-worldmodel-rs"


def _link(source: Path, place: Path) -> None:
    """Make ``place`` show ``source``, whatever it showed before."""
    if place.is_symlink() and place.resolve() == source.resolve():
        return
    place.parent.mkdir(parents=True, exist_ok=True)
    if place.is_symlink():
        place.unlink()
    elif place.exists():
        return
    try:
        place.symlink_to(source, target_is_directory=True)
    except OSError:
        shutil.copytree(source, place)
