"""The notebooks: those of the scripts beside them, without outputs; the first cell installs a wheel, and every cell runs; so do the scripts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import pytest

import stable_worldmodel_rs as swm

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "notebooks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.ipynb"))
needs = {"train_jepa": ["torch"]}

# Runs all cells of a notebook in one namespace, and shows the value of a last line that is an expression, as Jupyter does.
CELLS = """
import ast, json, sys
space = {"__name__": "__main__"}
for index, cell in enumerate(json.load(open(sys.argv[1]))["cells"]):
    if cell["cell_type"] != "code":
        continue
    tree = ast.parse("".join(cell["source"]), f"cell {index}")
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, f"cell {index}", "exec"), space)
    if last is not None:
        value = eval(compile(ast.Expression(last.value), f"cell {index}", "eval"), space)
        html = getattr(value, "_repr_html_", None)
        print(value if html is None else html())
"""


def environment() -> dict[str, str]:
    home = str(Path(swm.__file__).resolve().parents[1])
    return {**os.environ, "PYTHONPATH": home, "OMP_NUM_THREADS": "1", "PYDEVD_DISABLE_FILE_VALIDATION": "1"}


def check_needed(name: str) -> None:
    for package in needs.get(name, []):
        pytest.importorskip(package)


def test_there_are_four_and_they_are_those_of_the_scripts() -> None:
    assert NAMES == ["evaluate_and_compare", "first_steps", "robustness", "train_jepa"]
    done = subprocess.run([sys.executable, str(FOLDER / "make.py"), "--check"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in NAMES:
        cells = json.loads((FOLDER / f"{name}.ipynb").read_text())["cells"]
        assert all(not cell.get("outputs") and cell.get("execution_count") is None for cell in cells)


@pytest.mark.parametrize("name", NAMES)
def test_the_first_cell_installs_the_wheel_that_it_names(name: str, tmp_path: Path) -> None:
    wheel, installed = tmp_path / "tiny_notebook_wheel-1.0-py3-none-any.whl", tmp_path / "installed"
    about = "tiny_notebook_wheel-1.0.dist-info"
    with ZipFile(wheel, "w") as file:
        file.writestr("tiny_notebook_wheel.py", "")
        file.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\nName: tiny-notebook-wheel\nVersion: 1.0\n")
        file.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        file.writestr(f"{about}/RECORD", "")
    cells = json.loads((FOLDER / f"{name}.ipynb").read_text())["cells"]
    code = "".join(next(cell for cell in cells if cell["cell_type"] == "code")["source"])
    assert 'WHEEL = ""\n' in code
    code = code.replace('WHEEL = ""\n', f"WHEEL = {str(wheel)!r}\n")
    pip = {"PIP_TARGET": str(installed), "PIP_NO_INDEX": "1", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment() | pip, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (installed / "tiny_notebook_wheel.py").is_file()


@pytest.mark.parametrize("name", NAMES)
def test_every_cell_of_a_notebook_runs(name: str, tmp_path: Path) -> None:
    check_needed(name)
    notebook = FOLDER / f"{name}.ipynb"
    if find_spec("nbclient") and find_spec("ipykernel"):
        import nbformat  # type: ignore[import-not-found]
        from nbclient import NotebookClient  # type: ignore[import-not-found]

        # The kernel's interpreter is this one, whatever is registered under its name.
        code = (
            "import sys, nbformat\nfrom nbclient import NotebookClient\nfrom jupyter_client import KernelManager\n"
            "from jupyter_client.kernelspec import KernelSpec\n"
            "class Here(KernelManager):\n"
            "    @property\n"
            "    def kernel_spec(self):\n"
            "        argv = [sys.executable, '-m', 'ipykernel_launcher', '-f', '{connection_file}']\n"
            "        return KernelSpec(argv=argv, display_name='here', language='python')\n"
            "notebook = nbformat.read(sys.argv[1], 4)\n"
            "nbformat.validate(notebook)\n"
            "NotebookClient(notebook, timeout=300, kernel_manager_class=Here).execute()\n"
            "print(sum(len(cell.get('outputs', ())) for cell in notebook.cells))\n"
        )
        assert nbformat and NotebookClient
    else:
        code = CELLS
    done = subprocess.run(
        [sys.executable, "-c", code, str(notebook)], cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    assert done.stdout.strip() not in ("", "0"), "a notebook shows what it does"


@pytest.mark.parametrize("name", NAMES)
def test_the_script_runs(name: str, tmp_path: Path) -> None:
    check_needed(name)
    done = subprocess.run(
        [sys.executable, str(FOLDER / f"{name}.py")], cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
