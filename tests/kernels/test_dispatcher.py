"""Two forms of a kernel: for other kernels alone, and for Python."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core import types
from numba.core.errors import NumbaError

from kernels.folder import FOR_KERNELS
from kernels.with_numba import compiled


@pytest.fixture(autouse=True)
def store(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An empty store."""
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    return tmp_path / "kernels"


def _forms(store: Path) -> dict[str, list[bool]]:
    """For each kernel with a file, whether its files are for kernels alone."""
    kept: dict[str, list[bool]] = {}
    for file in sorted(store.iterdir()):
        name = file.name.rpartition("-")[0].rpartition(".")[2]
        kept.setdefault(name, []).append(file.name.endswith(FOR_KERNELS))
    return {name: sorted(forms) for name, forms in kept.items()}


def test_what_only_kernels_call_has_no_entry_until_python_calls_it(store: Path) -> None:
    assert _quarter(3.0) == 0.75
    assert _forms(store) == {"_half": [True], "_quarter": [False]}
    assert _half(3.0) == 1.5
    assert _forms(store) == {"_half": [False, True], "_quarter": [False]}
    with pytest.raises(ValueError, match="below zero"):
        _quarter(-1.0)
    with pytest.raises(ValueError, match="below zero"):
        _half(-1.0)


@compiled
def _half(x: float) -> float:
    if x < 0:
        raise ValueError("below zero")
    return x / 2


@compiled
def _quarter(x: float) -> float:
    return _half(_half(x))


@compiled
def _twice(x: np.ndarray) -> np.ndarray:
    return x[::-1] * 2


@compiled
def _four_times(x: np.ndarray) -> np.ndarray:
    return _twice(_twice(x))


def test_a_form_for_kernels_is_read_by_those_compiled_after(store: Path) -> None:
    _twice.compile_for_kernels((types.Array(types.float64, 1, "C"),))
    assert _forms(store) == {"_twice": [True]}
    assert _four_times(np.array([1.0, 3.0])).tolist() == [4.0, 12.0]
    assert _twice(np.array([1.0, 3.0])).tolist() == [6.0, 2.0]


@compiled
def _longest_gap(x: np.ndarray) -> float:
    gaps = np.empty(len(x) - 1)
    for k in range(len(gaps)):
        gaps[k] = x[k + 1] - x[k]
    return float(gaps.max())


@partial(compiled, _nrt=False)
def _gap_or_none(x: np.ndarray, y: np.ndarray, one: bool) -> float:
    chosen = x if one else y
    return float(_longest_gap(chosen)) if len(chosen) > 1 else -1.0


@partial(compiled, _nrt=False)
def _copied(x: np.ndarray) -> float:
    return float(x.copy().sum())


def test_a_kernel_of_numbers_alone_counts_no_references(store: Path) -> None:
    """But what it calls does, though it is compiled for it."""
    x = np.array([1.0, 2.0, 4.0])
    assert _gap_or_none(x, x[:1], True) == 2.0
    assert _gap_or_none(x, x[:1], False) == -1.0
    assert _counts("_gap_or_none", _gap_or_none) == (False, True)


def test_a_kernel_that_makes_an_array_must_count_references(store: Path) -> None:
    with pytest.raises(NumbaError, match="NRT required"):
        _copied(np.ones(2))


def _counts(name: str, kernel: Any) -> tuple[bool, bool]:
    """Whether a kernel's own code counts references, and whether any that it calls does."""
    (made,) = kernel.overloads.values()
    code = made.library.get_llvm_str()
    parts = re.split(r"^define ", code, flags=re.MULTILINE)[1:]
    counting = [part for part in parts if "@NRT_incref(" in part or "@NRT_decref(" in part]
    kernels = [part for part in counting if not re.match(r"[^@]*@(NRT|_ZN7cpython)", part)]
    own = [part for part in kernels if name in part.partition("(")[0]]
    return bool(own), len(kernels) > len(own)
