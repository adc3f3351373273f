"""Progress for other programs: one JSON line per step, appended to a file.

The first line is ``{"event": "begin", "pid": ..., "stages": [...], "until": ...}``; then come
``stage`` (``name``, ``fraction`` from 0 to 1, ``note``), ``done`` (``name``, ``note``) and
``remark`` (``name``, ``note``); the last is ``{"event": "end", "result": ..., "message": ...}``,
with result ``done``, ``failed`` or ``interrupted``. Each line has ``time``, seconds since 1970.
A process that was killed leaves no ``end``.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

_INTERRUPTED: Final = "interrupted; finished stages are kept"
LEAST_S: Final = 0.2
"""No two lines of a stage's progress are written within less."""


@dataclass
class ProgressFile:
    """Writes one run's progress.

    Attributes
    ----------
    path : Path
        Begun anew by `begin`.
    clock : function
        Seconds since 1970.
    """

    path: Path
    clock: Callable[[], float] = time.time
    _last: float = 0.0
    _stage: str = ""
    _begun: bool = field(default=False)

    def begin(self, stages: Sequence[str], until: str) -> None:
        """Say which stages there will be."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.unlink(missing_ok=True)
        self._begun = True
        self._write("begin", pid=os.getpid(), stages=list(stages), until=until)

    def stage(self, name: str, fraction: float, note: str = "") -> None:
        """Say how far a stage is; seldom enough for a file."""
        now = self.clock()
        if name == self._stage and now - self._last < LEAST_S:
            return
        self._stage, self._last = name, now
        self._write("stage", name=name, fraction=round(float(fraction), 4), note=note)

    def done(self, name: str, note: str) -> None:
        """Say that a stage has ended well."""
        self._write("done", name=name, note=note)

    def remark(self, name: str, text: str) -> None:
        """Hand on what the user should know of a stage."""
        self._write("remark", name=name, note=text)

    @contextmanager
    def whole(self, message_of: Callable[[Exception], str | None]) -> Iterator[None]:
        """Write the last line when what is done inside ends, whichever way.

        Parameters
        ----------
        message_of : function
            What to say of a failure; None for a fault of the program's own.
        """
        try:
            yield
        except KeyboardInterrupt:
            self._end("interrupted", _INTERRUPTED)
            raise
        except Exception as exc:
            # In a compiled kernel an interrupt comes out as a SystemError that it caused.
            if isinstance(exc.__cause__, KeyboardInterrupt):
                self._end("interrupted", _INTERRUPTED)
                raise KeyboardInterrupt from exc
            self._end("failed", message_of(exc) or f"{type(exc).__name__}: {exc}")
            raise
        self._end("done", "")

    def _end(self, result: str, message: str) -> None:
        if not self._begun:
            self.begin((), "")
        self._write("end", result=result, message=message)

    def _write(self, event: str, **values: Any) -> None:
        line = json.dumps({"event": event, "time": round(self.clock(), 3), **values})
        # One write of a whole line, so that who reads meanwhile sees whole lines only.
        with self.path.open("a", encoding="utf-8") as handle:
            handle.write(line + "\n")
