"""Lock of a run folder."""

from __future__ import annotations

from pathlib import Path

from printctl.pipeline.lock import run_is_going_on, run_lock


def test_a_lock_tells_whether_a_run_is_going_on(tmp_path: Path) -> None:
    assert not run_is_going_on(tmp_path)
    with run_lock(tmp_path):
        assert run_is_going_on(tmp_path)
    assert not run_is_going_on(tmp_path)
