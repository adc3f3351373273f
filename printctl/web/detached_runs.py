"""Runs in processes of their own, each in its folder: start, progress, and end."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from printctl.pipeline.running.lock import is_run_active
from printctl.processes.alive import KILL, is_alive, send_signal
from printctl.sources import python_command

StageState = Literal["waiting", "running", "done", "failed"]
RunState = Literal["never", "starting", "running", "done", "failed", "interrupted"]


@dataclass
class StageProgress:
    """Progress of one stage: a ``fraction`` from 0 to 1, and what the user should know.

    ``note`` is what is being done, how long it took, or why it failed.
    """

    name: str
    state: StageState = "waiting"
    fraction: float = 0.0
    note: str = ""
    remarks: list[str] = field(default_factory=list)


@dataclass
class RunProgress:
    """A run as far as it is; 0 and empty is what isn't known.

    Attributes
    ----------
    until : str
        Last stage that was asked for.
    message : str
        Why it failed.
    begun, told : float, s since 1970
        When it began, and when it last said something.
    fraction : float, 0 to 1
        Share of the stages that is done, the one at work included.
    """

    name: str
    state: RunState = "never"
    until: str = ""
    stages: list[StageProgress] = field(default_factory=list)
    message: str = ""
    pid: int = 0
    begun: float = 0.0
    told: float = 0.0
    print_state: str = ""
    fraction: float = 0.0

    @property
    def going_on(self) -> bool:
        """Whether its process lives."""
        return self.state in ("starting", "running")

    def _take(self, step: dict[str, Any]) -> None:
        """Change it by a line of the progress file."""
        event, note = step.get("event"), str(step.get("note", ""))
        self.told = float(step.get("time", self.told))
        if event == "start":
            self.state, self.pid, self.begun = "starting", int(step.get("pid", 0)), self.told
        elif event == "begin":
            self.state, self.until = "running", str(step.get("until", ""))
            self.pid, self.begun = int(step.get("pid", 0)), self.told
            self.stages = [StageProgress(str(one)) for one in step.get("stages", ())]
        elif event == "end":
            result = step.get("result")
            ended: RunState = result if result in ("done", "interrupted") else "failed"
            self.break_off(ended, str(step.get("message", "")))
        elif event in ("stage", "done", "remark"):
            name = str(step.get("name", ""))
            stage = next((one for one in self.stages if one.name == name), StageProgress(name))
            if event == "remark":
                stage.remarks.append(note)
                return
            if stage not in self.stages:
                self.stages.append(stage)
            stage.state = "running" if event == "stage" else "done"
            stage.fraction = float(step.get("fraction", 0.0)) if event == "stage" else 1.0
            stage.note = note or stage.note

    def break_off(self, state: RunState, why: str) -> None:
        """End it; the stage at work has failed."""
        self.state, self.message = state, why
        for stage in self.stages:
            if stage.state == "running":
                stage.state, stage.note = "failed", why or stage.note


def read_progress(name: str, path: Path) -> RunProgress:
    """Read a run's file; a line that is half written, or none at all, is passed over."""
    run = RunProgress(name)
    for line in _text(path).splitlines():
        with contextlib.suppress(ValueError, AttributeError):
            run._take(json.loads(line))
    run.fraction = sum(one.fraction for one in run.stages) / max(len(run.stages), 1)
    return run


def _text(path: Path) -> str:
    with contextlib.suppress(OSError):
        return path.read_text(encoding="utf-8", errors="replace")
    return ""


PROGRESS, LOG = "progress.jsonl", "run.log"
_STARTS_S: Final = 60.0
"""A process that lives takes the folder's lock within this."""
_REHEARSALS: Final = "runs/*.rehearsal"
"""Folders of rehearsals (`REHEARSAL`, whose package the stop process does without)."""
_PATIENCE: Final = ((signal.SIGINT, 5.0), (signal.SIGTERM, 3.0), (KILL, 3.0))


class DetachedProcesses:
    """Commands of `printctl`, one a folder, each in a session of its own.

    A command writes its progress into its folder (`printctl.progress_file`) and holds the folder's
    lock: another process, such as the next server, finds it by these.
    """

    def __init__(self) -> None:
        self._children: dict[Path, subprocess.Popen[bytes]] = {}

    def spawn(self, folder: Path, command: Sequence[str], cwd: Path) -> None:
        """Start a command of ours (subcommand and arguments), told where to write its progress."""
        folder.mkdir(0o700, parents=True, exist_ok=True)
        (folder / PROGRESS).unlink(missing_ok=True)
        line = [*python_command("printctl"), *command]
        line += ["--progress-file", str((folder / PROGRESS).resolve())]
        with (folder / LOG).open("wb") as log:
            child = self._children[folder] = subprocess.Popen(
                line,
                cwd=cwd,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        # Until the command begins its file anew, others know of it by this.
        start = {"event": "start", "time": time.time(), "pid": child.pid}
        with (folder / PROGRESS).open("a", encoding="utf-8") as file:
            file.write(json.dumps(start) + "\n")

    def progress(self, name: str, folder: Path) -> RunProgress:
        """How far the command in a folder is; ``never`` when none was started."""
        run, child = read_progress(name, folder / PROGRESS), self._children.get(folder)
        if child is not None and child.poll() is None:
            if not run.going_on:  # not quite begun, or hasn't quite left yet
                run.state = "starting" if run.state == "never" else "running"
        elif run.going_on and not _lives(run, folder):
            lines = [] if run.stages else _text(folder / LOG).strip().splitlines()
            why = ": ".join(["the process is gone", *lines[-1:]])
            run.break_off("interrupted", f"{why}; start it again, finished stages are kept")
        return run

    def going_on(self, name: str, folder: Path) -> bool:
        """Whether a process, also one from a terminal, works in a folder."""
        return self.progress(name, folder).going_on or (folder.is_dir() and is_run_active(folder))

    def cancel(self, name: str, folder: Path) -> bool:
        """End the command in a folder and all that it started; False when none is going on."""
        run, child = self.progress(name, folder), self._children.get(folder)
        pid = child.pid if child is not None and child.poll() is None else run.pid
        if not run.going_on or not pid:
            return False
        for sign, wait_s in _PATIENCE:
            try:
                send_signal(pid, sign, group=True)
            except (ProcessLookupError, PermissionError):
                break
            deadline = time.monotonic() + wait_s
            while time.monotonic() < deadline:
                if (child.poll() is not None) if child is not None else not is_alive(pid):
                    return True
                time.sleep(0.05)
        return True

    def end_rehearsals(self, root: Path) -> int:
        """End all that are on their way to a simulated print in a workspace; how many."""
        found = [one for one in root.glob(_REHEARSALS) if not one.is_symlink()]
        return sum(self.cancel(one.name, one) for one in found)


def _lives(run: RunProgress, folder: Path) -> bool:
    soon = time.time() - run.begun < _STARTS_S
    return bool(run.pid) and is_alive(run.pid) and (soon or is_run_active(folder))
