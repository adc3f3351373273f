"""Kernels run without numba: the same values, and numba where there is no file or no way."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from kernels import jit, scalar_jit
from kernels.no_numba import BareKernel
from tests.slower import first_of

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or os.uname().machine != "x86_64",
    reason="machine code is loaded by the product on Linux on x86-64 alone",
)

KINDS = """
from typing import NamedTuple
import numpy as np
from kernels import jit, scalar_jit
class Law(NamedTuple):
    {fields}
@jit
def inner(x):
    return {factor} * np.hypot(x, 4.0)
@jit
def outer(values, law, on):
    found = np.zeros((len(values), 2))
    for k in range(len(values)):
        found[k, 0] = inner(values[k]) + law.slope
        found[k, 1] = np.sin(values[k]) if on else law.offset
    return found, found[0] > 1.0
@jit
def adds(n):
    return n + 1
@jit
def refuses(n):
    if n > 2:
        raise ValueError("too many")
    return [1.0] * n, ("a", n)
@jit
def hashes(n):
    return len({{"a", "b"}}) + n
@jit
def scaled(value, by=2.0):
    return value * by
@jit
def counts(text, byte):
    found = 0
    for k in range(len(text)):
        found += text[k] == byte
    return found
@jit
def fills(values):
    values[:] = 7
"""
RUN = """
import sys
import kernels
{before}
import kinds, numpy as np
even = np.arange(6.0)[::2]
fixed = np.arange(3.0); fixed.flags.writeable = False
found, above = kinds.outer(np.arange(3.0), kinds.Law({values}), True)
print(found.tolist(), above.tolist(), found.flags.owndata)
for values in (even, fixed):
    print(kinds.outer(values, kinds.Law({values}), False)[0].tolist())
print([type(one).__name__ for one in (kinds.adds(3), kinds.adds(2.5), kinds.adds(True))])
print(kinds.adds(np.arange(3)).tolist(), kinds.refuses(1))
print(kinds.counts(b"G1 X1", 49), kinds.counts(b"", 49))
print(kinds.scaled(3.0), kinds.scaled(3.0, 5.0))
rows = np.zeros((2, 3), order="F"); kinds.fills(rows); print(rows.tolist())
loaded = "numba.core" in sys.modules
print(kinds.hashes(3))
try:
    kinds.refuses(3)
except ValueError as exc:
    print(exc)
print(loaded, file=sys.stderr)
"""
SLOPE, OFFSET = "slope: float\n    offset: float", "offset: float\n    slope: float"


def _run(folder: Path, *, bare: bool, **kinds: str) -> tuple[str, bool]:
    """What a program prints, and whether it had loaded numba before it had to."""
    text = KINDS.format(**{"fields": SLOPE, "factor": "1.5"} | kinds)
    (folder / "kinds.py").write_text(text)
    before = "kernels.without_numba()" if bare else ""
    return _python(folder, RUN.format(before=before, values="2.0, 3.0"))


def _python(folder: Path, text: str) -> tuple[str, bool]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment = {
        **kept,
        "PRINTCTL_CACHE": str(folder / "cache"),
        "PYTHONPATH": f"{folder}{os.pathsep}{Path(__file__).parents[2]}",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", text],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout, done.stderr.strip().endswith("True")


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder with the files of all kernels, and what the program prints."""
    folder = tmp_path_factory.mktemp("compiled")
    by_numba, loaded = _run(folder, bare=False)
    assert loaded
    assert _run(folder, bare=True) == (by_numba, True)  # no files yet
    return folder, by_numba


@pytest.fixture
def folder(compiled: tuple[Path, str], tmp_path: Path) -> Path:
    """A copy of that folder."""
    return shutil.copytree(compiled[0], tmp_path / "copy")


def test_values_are_those_of_numba_and_the_second_run_loads_none_of_it(
    compiled: tuple[Path, str], folder: Path
) -> None:
    assert _run(folder, bare=True) == (compiled[1], False)


@pytest.mark.slow
def test_a_changed_kernel_below_and_changed_fields_give_new_values(
    compiled: tuple[Path, str], folder: Path
) -> None:
    for change in ({"factor": "2.5"}, {"fields": OFFSET}):
        by_numba, loaded = _run(folder, bare=True, **change)
        assert loaded
        assert by_numba != compiled[1]
        assert _run(folder, bare=True, **change) == (by_numba, False)


@pytest.mark.parametrize("cut", first_of([-50, 0, 100]))
def test_a_damaged_file_is_left_to_numba(
    compiled: tuple[Path, str], folder: Path, cut: int
) -> None:
    files = list((folder / "cache").rglob("*.nbo"))
    assert files
    for path in files:
        path.write_bytes(path.read_bytes()[:cut])
    assert _run(folder, bare=True) == (compiled[1], True)


def test_another_kernels_file_is_not_run(compiled: tuple[Path, str], folder: Path) -> None:
    one, other = (next((folder / "cache").rglob(f"kinds.{n}-*.nbo")) for n in ("adds", "fills"))
    other.write_bytes(one.read_bytes())
    assert _run(folder, bare=True)[0] == compiled[1]


def test_numbas_own_settings_leave_the_kernels_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from kernels import no_numba as bare

    monkeypatch.setattr(bare, "_ASKED", {"bare"})
    monkeypatch.chdir(tmp_path)
    for name in [name for name in os.environ if name.startswith("NUMBA_")]:
        monkeypatch.delenv(name)
    assert bare.bare_wanted()
    monkeypatch.setenv("NUMBA_BOUNDSCHECK", "1")
    assert not bare.bare_wanted()


def test_flags_are_those_of_the_kernels_that_numba_makes() -> None:
    def same(n: float) -> float:
        return n

    for decorate, flags in ((jit, {}), (scalar_jit, {"_nrt": False})):
        kernel: Any = decorate(same)
        assert BareKernel(same, flags).targetoptions == kernel.targetoptions
