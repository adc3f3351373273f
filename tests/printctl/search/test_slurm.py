"""Searches in jobs of a Slurm cluster; its commands are stood for by scripts."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from printctl.errors import PrintctlError, UsageError
from printctl.search.slurm import slurm_workers
from printctl.search.workers import Workers
from tests.printctl.search.small import SEARCH, left_behind, run, write
from tests.printctl.search.test_cluster import alone

SHORT = SEARCH | {"vary": {"seed": [1, 2]}}
SBATCH = """#!/bin/bash
echo "$@" > {folder}/asked
for k in 1 2; do setsid bash workers.sh > log$k 2>&1 & echo $! >> {folder}/pids; done
echo "77;cluster"
"""
SCANCEL = """#!/bin/bash
echo "$@" > {folder}/cancelled
for pid in $(cat {folder}/pids); do kill -- -$pid; done
"""


def stand_in(folder: Path, monkeypatch: pytest.MonkeyPatch, **commands: str) -> None:
    for name, text in commands.items():
        path = folder / name
        path.write_text(text.format(folder=folder))
        path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


@pytest.mark.slow
def test_jobs_find_the_same_and_are_cancelled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    srun = '#!/bin/bash\nexec "$@"\n'
    stand_in(tmp_path, monkeypatch, sbatch=SBATCH, scancel=SCANCEL, srun=srun)
    out = tmp_path / "a folder" / "out"
    settings = ["partition=short", "time=00:10:00", "setup=export PC_SET=1"]
    there = Workers(slurm=slurm_workers(2, settings, out))
    found = run(write(tmp_path / "a folder", SHORT), out, there)
    assert (found.made, found.broken) == (2, {})
    assert left_behind(out) == alone(tmp_path / "alone", SHORT)
    assert (tmp_path / "asked").read_text().split() == ["--parsable", "--array=1-2", "workers.sh"]
    assert (tmp_path / "cancelled").read_text().split() == ["77"]
    script = (out / "slurm" / "workers.sh").read_text().splitlines()
    for line in ("ntasks=1", "mem=4G", "partition=short", "time=00:10:00", "output=%A_%a.log"):
        assert f"#SBATCH --{line}" in script
    assert "export PC_SET=1" in script
    assert not list((out / "slurm").glob(".key-*"))


def test_what_cant_be_submitted_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    search, out = write(tmp_path, SHORT), tmp_path / "out"
    there = Workers(slurm=slurm_workers(1, [], out))
    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))
    with pytest.raises(PrintctlError, match="no sbatch here; begin the search on a login node"):
        run(search, out, there)
    refuses = "#!/bin/bash\necho 'invalid partition' >&2\nexit 1\n"
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    stand_in(tmp_path, monkeypatch, sbatch=refuses)
    with pytest.raises(PrintctlError, match="sbatch refuses: invalid partition; see --slurm-set"):
        run(search, out, there)
    assert not list((out / "slurm").glob(".key-*"))


def test_settings_without_jobs_and_two_kinds_of_workers_are_refused(tmp_path: Path) -> None:
    assert slurm_workers(None, [], tmp_path) is None
    with pytest.raises(UsageError, match="--slurm-set mem=8G needs --slurm JOBS"):
        slurm_workers(None, ["mem=8G"], tmp_path)
    with pytest.raises(UsageError, match="--slurm has workers of its own; leave --workers out"):
        Workers(2, slurm=slurm_workers(3, [], tmp_path))
