"""Start `printctl` commands as detached processes, one per folder; follow and cancel them.

It writes its progress into its folder (`printctl.progress_file`) and holds the folder's lock.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from printctl.pipeline.lock import is_run_active
from printctl.web.design.run_processes.progress import RunProgress, broken_off, read_progress

PROGRESS, LOG = "progress.jsonl", "run.log"

_STARTS_S: Final = 60.0
"""A process that lives takes the folder's lock within this."""

_PATIENCE: Final = ((signal.SIGINT, 5.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 3.0))


@dataclass
class DetachedProcesses:
    """Processes by the folders that they work in."""

    _children: dict[Path, subprocess.Popen[bytes]] = field(default_factory=dict)

    def spawn(self, folder: Path, command: Sequence[str], cwd: Path) -> None:
        """Start a command of ours that is told where to write its progress.

        Parameters
        ----------
        folder : Path
            Which it works in.
        command : sequence of str
            Subcommand and arguments.
        cwd : Path
        """
        folder.mkdir(parents=True, exist_ok=True)
        (folder / PROGRESS).unlink(missing_ok=True)
        line = [sys.executable, "-m", "printctl", *command]
        line += ["--progress-file", str((folder / PROGRESS).resolve())]
        with (folder / LOG).open("wb") as log:
            self._children[folder] = subprocess.Popen(
                line,
                cwd=cwd,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def progress(self, name: str, folder: Path) -> RunProgress:
        """How far the command in a folder is; ``never`` when none was started."""
        run = read_progress(name, folder / PROGRESS)
        child = self._children.get(folder)
        if child is not None and child.poll() is None:
            return replace(run, state="starting") if run.state == "never" else _leaving(run)
        if not run.going_on:
            return run if run.state != "never" or child is None else _dead(run, folder)
        return run if _lives(run, folder) else _dead(run, folder)

    def going_on(self, name: str, folder: Path) -> bool:
        """Whether a process, also one from a terminal, works in a folder."""
        return self.progress(name, folder).going_on or (folder.is_dir() and is_run_active(folder))

    def cancel(self, name: str, folder: Path) -> bool:
        """End the command in a folder and all that it started; False when none is going on."""
        run, child = self.progress(name, folder), self._children.get(folder)
        alive = child is not None and child.poll() is None
        pid = child.pid if child is not None and alive else run.pid
        if not run.going_on or not pid:
            return False
        _end(pid, child)
        return True


def _leaving(run: RunProgress) -> RunProgress:
    """A run whose process hasn't quite left yet is going on."""
    return run if run.going_on else replace(run, state="running")


def _lives(run: RunProgress, folder: Path) -> bool:
    if not run.pid or not _exists(run.pid):
        return False
    return is_run_active(folder) or time.time() - run.begun < _STARTS_S


def _dead(run: RunProgress, folder: Path) -> RunProgress:
    try:
        text = (folder / LOG).read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    last = text.strip().splitlines()[-1:] if not run.stages else []
    last_words = f": {last[0]}" if last else ""
    why = f"the process is gone{last_words}; start it again, finished stages are kept"
    return replace(broken_off(run, why), state="interrupted", message=why)


def _end(pid: int, child: subprocess.Popen[bytes] | None) -> None:
    for sign, wait_s in _PATIENCE:
        try:
            os.killpg(pid, sign)
        except (ProcessLookupError, PermissionError):
            return
        deadline = time.monotonic() + wait_s
        while time.monotonic() < deadline:
            if (child.poll() is not None) if child is not None else not _exists(pid):
                return
            time.sleep(0.05)


def _exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return not _is_dead(Path(f"/proc/{pid}/stat"))


def _is_dead(stat: Path) -> bool:
    """Whether a process has ended and only waits for its parent to take note (Linux)."""
    try:
        status = stat.read_text(encoding="utf-8", errors="replace")
        return status.rpartition(")")[2].split()[0] == "Z"
    except (OSError, IndexError):
        return False
