"""Compiled kernels on disk: reused when the content is the same, and never otherwise."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from kernels import cache_dir

LAW = """
from typing import NamedTuple
class Law(NamedTuple):
    {fields}
"""
KERNEL = """
from kernels import jit
@jit
def product(law, x):
    {doc}
    return law.slope * x
"""
RUN = """
from law import Law
from kernel import product
law = Law({values})
print(product(law, 2.0), bool(product.stats.cache_hits))
"""


def _run(folder: Path, fields: str, values: str, doc: str = "") -> str:
    (folder / "law.py").write_text(LAW.format(fields=fields))
    (folder / "kernel.py").write_text(KERNEL.format(doc=doc))
    root = Path(__file__).parents[2]
    environment = {
        **os.environ,
        "PRINTCTL_CACHE": str(folder / "cache"),
        "PYTHONPATH": f"{folder}{os.pathsep}{root}",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-c", RUN.format(values=values)]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()


SLOPE_FIRST = "slope: float\n    offset: float"
OFFSET_FIRST = "offset: float\n    slope: float"


def test_swapped_fields_of_an_argument_are_compiled_anew(tmp_path: Path) -> None:
    """The defect that gave wrong numbers: the argument's class stands in no kernel file."""
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0") == "6.0 False"
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0") == "6.0 True"
    assert _run(tmp_path, OFFSET_FIRST, "100.0, 3.0") == "6.0 False"


def test_a_docstring_compiles_nothing(tmp_path: Path) -> None:
    _run(tmp_path, SLOPE_FIRST, "3.0, 100.0", '"""Old."""')
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0", '"""New."""') == "6.0 True"


@pytest.mark.parametrize("damage", [b"", b"nonsense", None])
def test_a_damaged_file_is_compiled_anew(tmp_path: Path, damage: bytes | None) -> None:
    _run(tmp_path, SLOPE_FIRST, "3.0, 100.0")
    for path in (tmp_path / "cache").rglob("*.nbc"):
        path.write_bytes(path.read_bytes()[:-50] if damage is None else damage)
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0") == "6.0 False"
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0") == "6.0 True"


def test_a_folder_that_cannot_be_made_costs_only_time(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file stands in the way")
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0") == "6.0 False"


def test_cache_moves_with_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    assert cache_dir().parent == tmp_path
