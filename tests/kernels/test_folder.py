"""Stored kernels: loaded for the same sources alone, wherever those lie."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import kernels
from kernels import folder

CONSTANTS = "FACTOR = {factor}\n"
CALLER = """
from kernels import jit
from design.constants import FACTOR

@jit
def scaled(x):
    return x * FACTOR

if __name__ != "__main__":
    scaled(1.0)
    print(scaled(2.0), sum(scaled.stats.cache_hits.values()))
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of `kernels` beside a package with one kernel."""
    return _tree(tmp_path / "one", 3.0)


def _tree(root: Path, factor: float) -> Path:
    shutil.copytree(Path(kernels.__file__).parent, root / "kernels")
    design = root / "design"
    design.mkdir()
    (design / "__init__.py").write_text("")
    (design / "constants.py").write_text(CONSTANTS.format(factor=factor))
    (design / "caller.py").write_text(CALLER)
    return root


def _run(tree: Path, store: Path) -> list[float]:
    environment = os.environ | {"PYTHONPATH": str(tree), "PRINTCTL_CACHE": str(store)}
    command = [sys.executable, "-c", "import design.caller"]
    done = subprocess.run(
        command, cwd=tree, env=environment, capture_output=True, text=True, check=True
    )
    return [float(word) for word in done.stdout.split()]


def test_a_second_process_and_a_copy_of_the_sources_load_what_the_first_compiled(tree, tmp_path):
    assert _run(tree, tmp_path / "store") == [6.0, 0.0]
    assert _run(tree, tmp_path / "store") == [6.0, 1.0]
    assert _run(_tree(tmp_path / "two", 3.0), tmp_path / "store") == [6.0, 1.0]


def test_a_constant_changed_in_another_file_compiles_anew(tree, tmp_path) -> None:
    assert _run(tree, tmp_path / "store") == [6.0, 0.0]
    # Of another length: Python takes a file of the same size and second for unchanged.
    (tree / "design" / "constants.py").write_text(CONSTANTS.format(factor=50.0))
    assert _run(tree, tmp_path / "store") == [100.0, 0.0]


@pytest.mark.skipif(os.name == "nt", reason="a file in the folder's place")
def test_kernels_run_where_the_cache_cant_be_written(tree, tmp_path) -> None:
    (tmp_path / "store").write_text("a file in the folder's place")
    assert _run(tree, tmp_path / "store") == [6.0, 0.0]


def test_few_folders_of_former_sources_stay(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    for number in range(8):
        former = tmp_path / "kernels" / f"former{number}"
        former.mkdir(parents=True)
        os.utime(former, (number, number))
    folder._made.cache_clear()
    made = folder.kernel_folder()
    folder._made.cache_clear()
    left = {one.name for one in (tmp_path / "kernels").iterdir()}
    assert left == {made.name, *(f"former{number}" for number in range(4, 8))}
