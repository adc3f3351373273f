"""Kernel store on disk: reused only for identical content."""

import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from kernels import cache_dir
from kernels.files import read_whole, write_whole

TWO = """
import sys
from kernels import jit
@jit
def g(n):
    s = 0.0
    for i in range(n):
        s += 2.0
        if s > 1e9:
            s -= np.sin(s)
    return s
ga = g
@jit
def g(n):
    s = 0.0
    for i in range(n):
        s += 7.0
        if s > 1e9:
            s -= np.sin(s)
    return s
gb = g
@jit
def fa(n):
    return ga(n) + ga(n + 1)
@jit
def fb(n):
    return gb(n) + gb(n + 1)
"""
RING = """
from kernels import jit
@jit
def f(a):
    if a < 1:
        return 1.0
    return g(a - 1) + 1
@jit
def g(a):
    if a < 1:
        return 2.0
    return f(a - 1) + 2
"""
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
    return _python(folder, RUN.format(values=values))


def _python(folder: Path, text: str) -> str:
    root = Path(__file__).parents[2]
    environment = {
        **os.environ,
        "PRINTCTL_CACHE": str(folder / "cache"),
        "PYTHONPATH": f"{folder}{os.pathsep}{root}",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-c", text]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()


KINDS = """
import numba
import numpy as np
from kernels import jit, pjit
@jit
def hashes(n):
    return len({"a", "b"}) + n - 2
@jit
def draws(n):
    np.random.seed(1)
    return np.random.rand() < 2.0
@jit
def solves(n):
    a, b = np.zeros((n, n)), np.zeros(n)
    for k in range(n):
        a[k, k], b[k] = 2.0, 1.0
    return np.linalg.inv(a)[0, 0] + np.dot(b, b)
@jit
def sorts(n):
    return np.argsort(np.zeros(n), kind="mergesort")[0] + len([1.0] * n)
@pjit
def sums(n):
    found = np.zeros(n)
    for k in numba.prange(n):
        found[k] = np.arctan2(k, 2.0) ** 1.5
    return found[0]
"""
USED = """
import kinds
from kernels import jit
every = [kinds.hashes, kinds.draws, kinds.solves, kinds.sorts, kinds.sums]
print([float(one(3)) for one in every], [bool(one.stats.cache_hits) for one in every])
@jit
def after(n):
    return kinds.draws(n) + kinds.hashes(n)
print(after(3))
"""
SLOPE_FIRST = "slope: float\n    offset: float"
OFFSET_FIRST = "offset: float\n    slope: float"


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the kernel's file."""
    folder = tmp_path_factory.mktemp("compiled")
    assert _run(folder, SLOPE_FIRST, "3.0, 100.0") == "6.0 False"
    assert _run(folder, SLOPE_FIRST, "3.0, 100.0") == "6.0 True"
    return folder


def test_swapped_fields_of_an_argument_are_compiled_anew(compiled: Path, tmp_path: Path) -> None:
    """The defect that gave wrong numbers: the argument's class stands in no kernel file."""
    shutil.copytree(compiled / "cache", tmp_path / "cache")
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0") == "6.0 True"
    assert _run(tmp_path, OFFSET_FIRST, "100.0, 3.0") == "6.0 False"


def test_a_docstring_compiles_nothing(compiled: Path, tmp_path: Path) -> None:
    shutil.copytree(compiled / "cache", tmp_path / "cache")
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0", '"""New."""') == "6.0 True"


@pytest.mark.slow
def test_every_kind_of_kernel_runs_from_disk_and_beside_one_compiled_after(tmp_path: Path) -> None:
    (tmp_path / "kinds.py").write_text(KINDS)
    made, loaded = _python(tmp_path, USED), _python(tmp_path, USED)
    assert made == "[3.0, 1.0, 3.5, 3.0, 0.0] [False, False, False, False, False]\n4"
    assert loaded == "[3.0, 1.0, 3.5, 3.0, 0.0] [True, True, True, True, True]\n4"


def _flipped(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


DAMAGES = [
    pytest.param(_flipped, id="one bit"),
    pytest.param(lambda data: b"", id="empty"),
    pytest.param(lambda data: b"nonsense", id="nonsense"),
    pytest.param(lambda data: data[:-50], id="cut"),
]


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_not_read(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    path = tmp_path / "kernel.nbc"
    write_whole(path, pickle.dumps(("code", bytes(1000))))
    assert read_whole(path) == ("code", bytes(1000))
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    assert read_whole(path) is None
    (tmp_path / "other.nbc").write_bytes(whole)
    assert read_whole(tmp_path / "other.nbc") is None, "another kernel's"


@pytest.mark.slow
@pytest.mark.parametrize(
    "damage",
    [
        _flipped,
        *(pytest.param(*one.values, id=one.id, marks=pytest.mark.slow) for one in DAMAGES[1:]),
    ],
)
def test_a_damaged_file_is_compiled_anew(
    compiled: Path, tmp_path: Path, damage: Callable[[bytes], bytes]
) -> None:
    shutil.copytree(compiled / "cache", tmp_path / "cache")
    files = list((tmp_path / "cache").rglob("*.nbc"))
    assert files
    for path in files:
        path.write_bytes(damage(path.read_bytes()))
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0") == "6.0 False"
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0") == "6.0 True"


def test_a_folder_that_cannot_be_made_costs_only_time(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file stands in the way")
    assert _run(tmp_path, SLOPE_FIRST, "3.0, 100.0") == "6.0 False"


@pytest.mark.slow
def test_another_kernels_file_is_not_loaded(tmp_path: Path) -> None:
    (tmp_path / "two.py").write_text(TWO.replace("import sys", "import numpy as np"))
    _python(tmp_path, "import two; two.fa(3); two.fb(3)")
    first, second = sorted((tmp_path / "cache").rglob("two.f*.nbc"))
    second.write_bytes(first.read_bytes())
    assert _python(tmp_path, "import two; print(two.fa(3), two.fb(3))") == "14.0 49.0"


def test_kernels_of_one_name_from_two_processes_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "two.py").write_text(TWO.replace("import sys", "import numpy as np"))
    assert _python(tmp_path, "import two; print(two.fa(3))") == "14.0"
    assert _python(tmp_path, "import two; print(two.fb(3))") == "49.0"
    assert _python(tmp_path, "import two; print(two.fa(3), two.fb(3))") == "14.0 49.0"


@pytest.mark.slow
def test_kernels_that_call_each_other_are_compiled_in_each_process(tmp_path: Path) -> None:
    (tmp_path / "ring.py").write_text(RING)
    for _ in range(2):
        assert _python(tmp_path, "import ring; print(ring.f(4))") == "7.0"


def test_cache_moves_with_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    assert cache_dir().parent == tmp_path


SCRIPT = """
from typing import NamedTuple
from kernels import jit
class Point(NamedTuple):
    x: float
@jit
def made(x):
    return Point(x)
print(type(made(2.0)) is Point)
"""


@pytest.mark.slow
def test_a_script_is_compiled_each_time(tmp_path: Path) -> None:
    for _ in range(2):
        assert _python(tmp_path, SCRIPT) == "True"


@pytest.mark.slow
def test_a_global_changed_between_two_signatures_is_not_kept(tmp_path: Path) -> None:
    (tmp_path / "scaled.py").write_text(
        "from kernels import jit\nX = 1\n@jit\ndef k(x):\n    return x * X\n"
    )
    change = "import scaled; scaled.k(1.0); scaled.X = 5; print(scaled.k(1))"
    assert _python(tmp_path, change) == "5"
    assert _python(tmp_path, "import scaled; print(scaled.k(1), scaled.k(1.0))") == "1 1.0"
