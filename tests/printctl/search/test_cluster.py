"""Search workers: several processes, a cluster, and interruption."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from distributed import LocalCluster

from printctl.search.workers import Workers
from tests.printctl.search.small import SEARCH, left_behind, run, write

LONG = SEARCH | {"vary": {"seed": list(range(1, 13))}}
SHORT = SEARCH | {"vary": {"seed": [1, 2]}}
PATIENCE_S = 120


def alone(folder: Path, search: dict[str, Any]) -> dict[str, bytes]:
    """What a search leaves behind when this process alone has done it."""
    folder.mkdir()
    run(write(folder, search), folder / "out")
    return left_behind(folder / "out")


@pytest.mark.slow
def test_killed_it_loses_what_ran_and_goes_on_to_the_same_end(tmp_path: Path) -> None:
    path, out = write(tmp_path, LONG), tmp_path / "out"
    known = out / "candidates"
    command = [sys.executable, "-m", "printctl", "search", str(path), "--out", str(out)]
    search = subprocess.Popen([*command, "--workers", "1"], stderr=subprocess.DEVNULL)
    _wait_until(lambda: known.is_dir() and any(known.glob("[!.]*.json")), search)
    family = _children(search.pid)
    search.send_signal(signal.SIGKILL)
    search.wait()
    _wait_until(lambda: not any(_lives(process) for process in family))
    kept = {file: file.stat().st_ino for file in known.glob("[!.]*.json")}
    found = run(path, out)
    assert family, "it searched without workers"
    assert found.kept == len(kept) >= 1
    assert found.made == 12 - len(kept) > 0
    assert all(file.stat().st_ino == ino for file, ino in kept.items())
    assert left_behind(out) == alone(tmp_path / "alone", LONG)


def test_a_cluster_by_its_address_finds_the_same(tmp_path: Path) -> None:
    # Threads of this process stand for the cluster: what is asked here is the way there.
    quick = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "protocol": "tcp://"}
    with LocalCluster(**quick, host="127.0.0.1", dashboard_address="127.0.0.1:0") as cluster:
        assert cluster.scheduler_address.startswith("tcp://")
        there = Workers(None, cluster.scheduler_address)
        found = run(write(tmp_path, SHORT), tmp_path / "out", there)
    assert (found.made, found.broken) == (2, {})
    assert left_behind(tmp_path / "out") == alone(tmp_path / "alone", SHORT)


def _wait_until(happened: object, process: subprocess.Popen[bytes] | None = None) -> None:
    assert callable(happened)
    end = time.monotonic() + PATIENCE_S
    while not happened():
        assert process is None or process.poll() is None, "the search ended before it was killed"
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def _children(parent: int) -> list[int]:
    """All processes that descend from one; Linux."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and _parent(int(entry.name)) == parent:
            found += [int(entry.name), *_children(int(entry.name))]
    return found


def _parent(process: int) -> int | None:
    try:
        stat = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except OSError:
        return None
    return int(stat.rpartition(")")[2].split()[1])


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True
