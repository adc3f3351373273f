"""Stored kernels: loaded for the same sources alone, wherever those lie."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from numba import types

import kernels
from design.geometry.bvh import TriangleTree
from kernels import folder, jit
from kernels.ahead import NeededKernel, compiling, missing, needed_kernels, numba_type
from tests.kernels.record import WORKS, described

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


def _run(tree: Path, store: Path, code: str = "import design.caller") -> list[float]:
    environment = os.environ | {"PYTHONPATH": str(tree), "PRINTCTL_CACHE": str(store)}
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tree,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return [float(word) for word in done.stdout.split()]


def test_a_second_process_and_a_copy_of_the_sources_load_what_the_first_compiled(tree, tmp_path):
    assert _run(tree, tmp_path / "store") == [6.0, 0.0]
    assert _run(tree, tmp_path / "store") == [6.0, 1.0]
    assert _run(_tree(tmp_path / "two", 3.0), tmp_path / "store") == [6.0, 1.0]


ARRAYS = """
import numpy as np
import sys
from kernels import jit

@jit
def sorted_copy(x):
    if x[0] < 0:
        raise ValueError("negative")
    return np.sort(x), np.zeros(2)

if __name__ == "design.arrays":
    print(*sorted_copy(np.array([3.0, 1.0]))[0], int("numba.np.arraymath" in sys.modules))
    print(sum(sorted_copy.stats.cache_hits.values()))
    try:
        sorted_copy(np.array([-1.0]))
    except ValueError as exc:
        print(len(str(exc)))
    print(*sorted_copy(np.array([3, 1]))[0])
"""


def test_stored_code_is_loaded_without_what_compiles(tree, tmp_path):
    (tree / "design" / "arrays.py").write_text(ARRAYS)
    first = _run(tree, tmp_path / "store", "import design.arrays")
    assert first == [1.0, 3.0, 1.0, 0.0, 8.0, 1.0, 3.0]
    second = _run(tree, tmp_path / "store", "import design.arrays")
    assert second == [1.0, 3.0, 0.0, 1.0, 8.0, 1.0, 3.0]


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


# --- kernels compiled ahead: the list, and the processes that compile it
TREE = types.BaseTuple.from_types([types.float64[:, ::1]] * len(TriangleTree._fields), TriangleTree)


@pytest.mark.parametrize(
    "one",
    [
        types.int64,
        types.boolean,
        types.none,
        types.Array(types.int32, 2, "F"),
        types.Array(types.float64, 1, "C", readonly=True),
        types.Bytes(types.uint8, 1, "C"),
        types.Tuple([types.int64, types.float64[::1]]),
        types.UniTuple(TREE, 2),
    ],
)
def test_types_come_back_as_they_were(one) -> None:
    assert numba_type(json.loads(json.dumps(described(one)))) == one


def test_each_listed_kernel_is_there_with_its_types() -> None:
    """Else ``python -m tests.kernels.record`` makes the list anew."""
    rows = needed_kernels()
    assert len(rows) > 400
    assert {work for one in rows for work in one.by} <= set(WORKS)
    for one in rows:
        module, _, name = one.kernel.partition(":")
        assert module.replace(".", "/").startswith(folder.PACKAGES), one.kernel
        assert callable(getattr(import_module(module), name).py_func), one.kernel
        assert [described(numba_type(data)) for data in json.loads(one.takes)] == json.loads(
            one.takes
        )


def test_what_is_compiled_ahead_is_missing_no_more(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    folder._made.cache_clear()
    row = next(
        one for one in needed_kernels() if one.kernel == "design.geometry.crossings:plane_side"
    )
    wrong = NeededKernel("design.geometry.crossings:nothing", row.takes, row.by)
    late = next(
        one for one in needed_kernels() if one.kernel == "design.geometry.crossings:meeting_kind"
    )
    done: list[int] = []
    with compiling([row, wrong], [late], done.append) as failed:
        assert (failed, done) == (1, [1, 2])
        while not list(tmp_path.rglob("*meeting_kind*.nbc")):
            time.sleep(0.05)
    assert missing([row, wrong]) == [wrong]
    assert list(tmp_path.rglob("*plane_side*"))
    folder._made.cache_clear()


# --- compiler flags of the kernels
@jit
def _ratio(a: float, b: float) -> float:
    return a / b


def test_nan_and_infinity_keep_their_meaning() -> None:
    assert np.isinf(_ratio(1.0, 0.0))
    assert np.isnan(_ratio(0.0, 0.0))
    assert np.isnan(_ratio(np.nan, 1.0))


@jit
def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.dot(a, b)


def test_matrix_products_work() -> None:
    assert (_product(2 * np.eye(2), np.ones((2, 2))) == 2).all()


# Reuse of freed memory for large arrays.

KEPT_THEN_GIVEN_BACK = """
import numpy as np
from kernels import keep_freed_memory
from pathlib import Path

def held():
    return 4096 * int(Path("/proc/self/statm").read_text().split()[1])

before = held()
with keep_freed_memory():
    for _ in range(3):
        large = np.ones(12_000_000)
        del large
    kept = held() - before
after = held() - before
assert kept > 90e6, kept
assert after < 10e6, after
"""


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallopt"), reason="the C library has no mallopt"
)
def test_freed_memory_is_kept_within_and_given_back_behind() -> None:
    subprocess.run([sys.executable, "-c", KEPT_THEN_GIVEN_BACK], check=True)
