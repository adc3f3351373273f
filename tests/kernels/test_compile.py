"""The kernel cache's key covers every source that takes part."""

from pathlib import Path

import numpy as np
import pytest

from kernels import cache_dir, jit
from kernels.compile import source_key


@jit
def _ratio(a: float, b: float) -> float:
    return a / b


def test_nan_and_infinity_keep_their_meaning() -> None:
    assert np.isinf(_ratio(1.0, 0.0))
    assert np.isnan(_ratio(0.0, 0.0))
    assert np.isnan(_ratio(np.nan, 1.0))


def test_key_changes_with_any_kernel_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "design" / "a.py"
    source.parent.mkdir()
    monkeypatch.setattr("kernels.compile._ROOT", tmp_path)
    keys = []
    for text in ("from kernels import jit", "from kernels import pjit", "nothing of interest"):
        source.write_text(text)
        source_key.cache_clear()
        keys.append(source_key())
    source_key.cache_clear()
    assert len(set(keys)) == 3


def test_cache_moves_with_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    cache_dir.cache_clear()
    try:
        assert cache_dir().parent.parent == tmp_path
    finally:
        cache_dir.cache_clear()
