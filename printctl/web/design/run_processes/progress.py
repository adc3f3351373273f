"""Read a running pipeline's progress from the file that it writes (`printctl.progress_file`)."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

StageState = Literal["waiting", "running", "done", "failed"]
RunState = Literal["never", "starting", "running", "done", "failed", "interrupted"]


@dataclass(frozen=True)
class StageProgress:
    """Progress of one stage.

    Attributes
    ----------
    name : str
    state : StageState
    fraction : float, 0 to 1
    note : str
        What is being done, how long it took, or why it failed.
    remarks : tuple of str
        What the user should know.
    """

    name: str
    state: StageState = "waiting"
    fraction: float = 0.0
    note: str = ""
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class RunProgress:
    """A run as far as it is.

    Attributes
    ----------
    name : str
    state : RunState
    until : str
        Last stage that was asked for; empty when nothing is known.
    stages : tuple of StageProgress
    message : str
        Why it failed.
    pid : int
        0 when not known.
    begun, told : float, s since 1970
        When it began, and when it last said something; 0 when not known.
    """

    name: str
    state: RunState = "never"
    until: str = ""
    stages: tuple[StageProgress, ...] = ()
    message: str = ""
    pid: int = 0
    begun: float = 0.0
    told: float = 0.0

    @property
    def going_on(self) -> bool:
        """Whether its process lives."""
        return self.state in ("starting", "running")

    @property
    def fraction(self) -> float:
        """Share of the stages that is done, the one at work included."""
        return sum(one.fraction for one in self.stages) / max(len(self.stages), 1)


def read_progress(name: str, path: Path) -> RunProgress:
    """Read a run's file; a line that is half written, or none at all, is passed over."""
    progress = RunProgress(name)
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return progress
    for line in text.splitlines():
        try:
            step = json.loads(line)
        except ValueError:
            continue
        if isinstance(step, dict):
            progress = _after(progress, step)
    return progress


def _after(run: RunProgress, step: dict[str, Any]) -> RunProgress:
    run = replace(run, told=float(step.get("time", run.told)))
    event, note = step.get("event"), str(step.get("note", ""))
    if event == "begin":
        stages = tuple(StageProgress(str(one)) for one in step.get("stages", ()))
        return RunProgress(
            run.name, "running", str(step.get("until", "")), stages,
            pid=int(step.get("pid", 0)), begun=run.told, told=run.told,
        )  # fmt: skip
    if event == "end":
        return _ended(run, str(step.get("result", "failed")), str(step.get("message", "")))
    name = str(step.get("name", ""))
    if event == "stage":
        return _with(run, name, "running", float(step.get("fraction", 0.0)), note)
    if event == "done":
        return _with(run, name, "done", 1.0, note)
    if event == "remark":
        stages = tuple(
            replace(one, remarks=(*one.remarks, note)) if one.name == name else one
            for one in run.stages
        )
        return replace(run, stages=stages)
    return run


def _with(run: RunProgress, name: str, state: StageState, done: float, note: str) -> RunProgress:
    known = any(one.name == name for one in run.stages)
    before = run.stages if known else (*run.stages, StageProgress(name))
    stages = tuple(
        replace(one, state=state, fraction=done, note=note or one.note) if one.name == name else one
        for one in before
    )
    return replace(run, stages=stages)


def _ended(run: RunProgress, result: str, message: str) -> RunProgress:
    state: RunState = (
        "done" if result == "done" else "interrupted" if result == "interrupted" else "failed"
    )
    return replace(broken_off(run, message), state=state, message=message)


def broken_off(run: RunProgress, why: str) -> RunProgress:
    """The run with the stage at work marked as failed."""
    stages = tuple(
        replace(one, state="failed", note=why or one.note) if one.state == "running" else one
        for one in run.stages
    )
    return replace(run, stages=stages)
