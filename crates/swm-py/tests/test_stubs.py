"""The type stubs say what the compiled module has: every name, every parameter with its default; and all is documented."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path
from typing import Any

import pytest

import stable_worldmodel_rs as swm
from stable_worldmodel_rs import _swm

PACKAGE = Path(swm.__file__).parent
STUB = ast.parse((PACKAGE / "_swm.pyi").read_text())


def parameters(function: ast.FunctionDef) -> list[tuple[str, str | None]]:
    """Names of a stub's parameters, without `self` and `cls`, and their defaults as text."""
    plain = function.args.posonlyargs + function.args.args
    defaults = [None] * (len(plain) - len(function.args.defaults)) + list(function.args.defaults)
    both = list(zip(plain, defaults)) + list(zip(function.args.kwonlyargs, function.args.kw_defaults))
    return [
        (argument.arg, None if default is None else ast.unparse(default))
        for argument, default in both
        if argument.arg not in ("self", "cls")
    ]


def actual(text: str) -> list[tuple[str, str | None]]:
    """The same of a signature as PyO3 gives it."""
    function = ast.parse(f"def f{text.replace('$', '')}: ...").body[0]
    assert isinstance(function, ast.FunctionDef)
    return parameters(function)


def same(stub: list[tuple[str, str | None]], found: list[tuple[str, str | None]]) -> bool:
    """Whether names agree, and defaults where the module tells them (`...` where it does not)."""
    names = [name for name, _ in stub] == [name for name, _ in found]
    return names and all(
        (mine is None) == (theirs is None)
        and (mine == theirs or "..." in (mine, theirs) or "Ellipsis" in (mine, theirs))
        for (_, mine), (_, theirs) in zip(stub, found)
    )


def stubbed(kind: type) -> dict[str, Any]:
    return {node.name: node for node in STUB.body if isinstance(node, kind)}  # type: ignore[attr-defined]


def test_the_stub_has_every_name_and_no_other() -> None:
    names = set(stubbed(ast.FunctionDef)) | {name for name in stubbed(ast.ClassDef) if name != "_Bridge"}
    names |= {
        node.target.id for node in STUB.body if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    names -= {name for name in names if name.startswith("_") and name != "__version__"}
    there = {name for name in vars(_swm) if not name.startswith("__")} | {"__version__"}
    assert names == there, (sorted(names - there), sorted(there - names))


@pytest.mark.parametrize("name", sorted(stubbed(ast.FunctionDef)))
def test_functions_have_the_parameters_of_the_stub(name: str) -> None:
    stub, found = parameters(stubbed(ast.FunctionDef)[name]), actual(getattr(_swm, name).__text_signature__)
    assert same(stub, found), (stub, found)


@pytest.mark.parametrize("name", sorted(name for name in stubbed(ast.ClassDef) if name != "_Bridge"))
def test_classes_have_the_members_of_the_stub(name: str) -> None:
    there: Any = getattr(_swm, name)
    if issubclass(there, Exception):
        assert issubclass(there, ValueError) and there.__doc__
        return
    members = {node.name: node for node in stubbed(ast.ClassDef)[name].body if isinstance(node, ast.FunctionDef)}
    special = ("__iter__", "__next__", "__len__")
    found = {member for member in vars(there) if not member.startswith("__") or member in special}
    assert set(members) - {"__new__"} == found, sorted(set(members) ^ found)
    for member, node in members.items():
        if member == "__new__":
            signature = there.__text_signature__
        elif member in special or any(
            isinstance(mark, ast.Name) and mark.id == "property" for mark in node.decorator_list
        ):
            continue
        else:
            signature = getattr(there, member).__text_signature__
        assert same(parameters(node), actual(signature)), (member, signature)


@pytest.mark.parametrize("module", [swm, swm.planning, swm.world], ids=lambda module: module.__name__)
def test_type_checkers_see_the_names_that_are_loaded_late(module: Any) -> None:
    tree = ast.parse(Path(module.__file__).read_text())
    seen = {
        alias.asname or alias.name: node.module
        for block in tree.body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == {**module._HOMES, **dict.fromkeys(getattr(module, "_MODULES", ()))}
    assert set(seen) <= set(module.__all__)
    # Some of planning's names are torch modules.
    assert module is swm.planning or all(hasattr(module, name) for name in module.__all__)


def test_the_package_says_that_it_is_typed() -> None:
    assert (PACKAGE / "py.typed").is_file()


def sources() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if "_lib" not in path.parts)


@pytest.mark.parametrize("path", sources(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_files_are_documented_and_typed(path: Path) -> None:
    tree = ast.parse(path.read_text())
    assert ast.get_docstring(tree), "the first line says what the file is"
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            untyped = [one.arg for one in arguments if one.annotation is None and one.arg not in ("self", "cls")]
            assert not untyped and node.returns is not None, f"{node.name}: {untyped or 'no return type'}"


def test_public_classes_explain_themselves() -> None:
    for name in swm.__all__:
        value = getattr(swm, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            assert inspect.getdoc(value), name


def test_torch_is_imported_nowhere_at_the_top() -> None:
    for path in sources():
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.Import):
                assert all(alias.name.split(".")[0] != "torch" for alias in node.names), path
            if isinstance(node, ast.ImportFrom):
                assert (node.module or "").split(".")[0] != "torch", path
