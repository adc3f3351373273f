"""Notebooks: run without error, stored without output."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import nbformat
import pytest
from IPython.display import Image

from tests.slower import first_of

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
# A pipe between kernel and client, since any user of the machine could read a port.
EXECUTE = [sys.executable, "-c", "from nbclient.cli import main; main()", "--inplace"]
OVER_A_PIPE = "--KernelManager.transport=ipc"


def cells(path: Path) -> list[nbformat.NotebookNode]:
    return [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_stored_without_outputs(path: Path):
    assert cells(path)
    assert all(not cell.outputs and cell.execution_count is None for cell in cells(path))


@pytest.mark.parametrize("path", first_of(NOTEBOOKS), ids=lambda path: path.stem)
def test_code_of_a_notebook_runs_and_draws(path: Path, monkeypatch: pytest.MonkeyPatch):
    """As in Jupyter, but for Jupyter: three processes that import the same once more."""
    drawn: list[object] = []
    monkeypatch.setattr(plt, "show", lambda: drawn.extend(plt.get_fignums()))
    plt.switch_backend("agg")
    names: dict[str, object] = {}
    for cell in cells(path):
        tree = ast.parse(cell.source)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, path.name, "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), path.name, "eval"), names)
            drawn += [value] if isinstance(value, Image) else []
    plt.close("all")
    assert len(drawn) >= 2


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_and_draws(path: Path, tmp_path: Path):
    copy = tmp_path / path.name
    shutil.copy(path, copy)
    words = {
        "PYTHONPATH": str(ROOT),
        "JUPYTER_RUNTIME_DIR": str(tmp_path),
        "IPYTHONDIR": str(tmp_path),
    }
    done = subprocess.run(
        [*EXECUTE, OVER_A_PIPE, str(copy)],
        env={**os.environ, **words},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    drawn = [
        output
        for cell in cells(copy)
        for output in cell.outputs
        if "image/png" in output.get("data", {})
    ]
    assert len(drawn) >= 2
