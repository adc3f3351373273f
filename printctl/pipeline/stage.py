"""Stage of the pipeline: what it depends on, reads and does; its time and memory."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from printctl.progress import Report
from printctl.run_folder.manifest import digest_file, digest_json
from printctl.sources import source_digest

if TYPE_CHECKING:
    from printctl.pipeline.context import RunContext

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
