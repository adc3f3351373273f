"""Run pipeline stages in order with time and memory, skipping those up to date."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from design.files import atomic_replacement
from printctl.progress import Report, StageBars
from printctl.run_folder.manifest import StageRecord, digest_file, digest_json
from printctl.sources import source_digest

if TYPE_CHECKING:
    from printctl.pipeline.context import RunContext

# Measure run time and memory of a pipeline stage.

_STATUS = Path("/proc/self/status")
_CLEAR = Path("/proc/self/clear_refs")


def _reset_peak() -> None:
    """Linux only: writing 5 sets the peak of resident memory back to what is resident now."""
    if _CLEAR.exists():
        _CLEAR.write_text("5")


def peak_mb() -> float:
    """Peak resident memory of this process in MB (10⁶ bytes); since the last reset on Linux."""
    if _STATUS.exists():
        for line in _STATUS.read_text().splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) * 1024 / 1e6
    if sys.platform == "win32":
        return 0.0
    import resource  # Unix only, hence not at the top.

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


@dataclass
class RunMeter:
    """Context manager: wall seconds and peak MB of what runs inside."""

    seconds: float = 0.0
    peak_mb: float = 0.0
    _begin: float = 0.0

    def __enter__(self) -> RunMeter:
        _reset_peak()
        self._begin = time.perf_counter()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.seconds = time.perf_counter() - self._begin
        self.peak_mb = peak_mb()


@dataclass(frozen=True)
class Stage:
    """One stage.

    Attributes
    ----------
    name : str
        As the user sees it.
    depends : function of the context
        JSON-able value of everything from the recipe that the stage reads.
    reads : names, or function of the context
        Files of the run folder that the stage reads.
    code : names
        Packages whose sources take part; a changed source makes the stage run again.
    work : function of the context and a progress report
        Does the work, returns the stage's summary (JSON-able) and the files it wrote.
    asked : function of the context
        Whether the recipe wants it; by default always.
    """

    name: str
    depends: Callable[[RunContext], Any]
    reads: tuple[str, ...] | Callable[[RunContext], tuple[str, ...]]
    code: tuple[str, ...]
    work: Callable[[RunContext, Report], tuple[dict[str, Any], Sequence[str]]]
    asked: Callable[[RunContext], bool] = lambda context: True

    def key(self, context: RunContext) -> str:
        """Hash of all that goes into the stage."""
        names = self.reads(context) if callable(self.reads) else self.reads
        files = {name: digest_file(context.folder / name) for name in names}
        return digest_json([self.name, self.depends(context), files, source_digest(self.code)])


def run_stages(context: RunContext, stages: Sequence[Stage], bars: StageBars) -> None:
    """Run each stage whose inputs have changed; reuse the others.

    The record of a stage is dropped before it runs, so that a stage that fails half-way isn't
    taken for done.
    """
    with bars.all():
        for stage in wanted_stages(context, stages):
            name = f"{context.title} {stage.name}".strip()
            with bars.stage(name) as report:
                note = _run_one(context, stage, report)
            bars.say(name, note)


def run_under_one_bar(
    context: RunContext, stages: Sequence[Stage], bars: StageBars, name: str
) -> None:
    """Run stages as `run_stages`, under one bar: of many parts that are all made alike."""
    with bars.all(), bars.stage(name) as report, RunMeter() as meter:
        notes = []
        stages = wanted_stages(context, stages)
        for number, stage in enumerate(stages):
            report(number / len(stages), stage.name)
            notes.append(_run_one(context, stage, lambda fraction, note="": None))
    new = [note for note in notes if note.endswith(" s")]
    kept = f", {len(notes) - len(new)} of {len(notes)} stages as before or as in another well"
    bars.say(name, f"{meter.seconds:.1f} s{kept if len(new) < len(notes) else ''}")


def wanted_stages(context: RunContext, stages: Sequence[Stage]) -> list[Stage]:
    """The stages that the recipe asks for; what an earlier recipe asked for is forgotten."""
    for stage in stages:
        if not stage.asked(context):
            context.manifest.stages.pop(stage.name, None)
    return [stage for stage in stages if stage.asked(context)]


def _run_one(context: RunContext, stage: Stage, report: Report) -> str:
    key = stage.key(context)
    record = context.manifest.stages.get(stage.name)
    if record is not None and record.still_valid(key, context.folder):
        context.reused.add(stage.name)
        return f"unchanged ({record.seconds:.1f} s when made)"
    for other in context.siblings:
        theirs = other.manifest.stages.get(stage.name)
        if theirs is not None and theirs.still_valid(key, other.folder):
            _take_over(context, stage, theirs, other.folder)
            return f"as in {other.folder.name}"
    context.manifest.stages.pop(stage.name, None)
    with RunMeter() as meter:
        summary, outputs = stage.work(context, report)
    digests = {name: digest_file(context.folder / name) for name in outputs}
    context.manifest.stages[stage.name] = StageRecord(
        key, digests, summary, round(meter.seconds, 3), round(meter.peak_mb, 1)
    )
    context.manifest.save()
    return f"{meter.seconds:.1f} s"


def _take_over(context: RunContext, stage: Stage, record: StageRecord, folder: Path) -> None:
    """Copy what another folder's run of the same made."""
    context.manifest.stages.pop(stage.name, None)
    for name in record.outputs:
        with atomic_replacement(context.folder / name) as draft:
            shutil.copyfile(folder / name, draft)
    context.manifest.stages[stage.name] = record
    context.manifest.save()
    context.reused.add(stage.name)
