"""Lock of a run folder."""

from __future__ import annotations

from pathlib import Path

from printctl.pipeline.lock import is_run_active, run_lock


def test_a_lock_tells_whether_a_run_is_going_on(tmp_path: Path) -> None:
    assert not is_run_active(tmp_path)
    with run_lock(tmp_path):
        assert is_run_active(tmp_path)
    assert not is_run_active(tmp_path)
