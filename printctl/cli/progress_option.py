"""`--progress-file` option: write a command's progress to a file for other programs to read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from printctl.failures import message_and_code
from printctl.pipeline.lock import run_lock
from printctl.progress_file import ProgressFile

ProgressFileOption = Annotated[
    Path | None,
    typer.Option("--progress-file", help="Append progress to this file, a line of JSON a step."),
]


def message_of(exc: Exception) -> str | None:
    """Return the user's message for a failure; None for an internal error."""
    known = message_and_code(exc)
    return None if known is None else known[0]


@dataclass
class Steps:
    """A command's few steps, told as a run's stages; nothing without a file.

    Attributes
    ----------
    path : Path or None
    folder : Path
        Which the command works in; locked meanwhile where progress is asked for.
    names : sequence of str
    """

    path: Path | None
    folder: Path
    names: Sequence[str]
    _at: list[str] = field(default_factory=list)
    _told: ProgressFile | None = None

    @contextmanager
    def whole(self) -> Iterator[None]:
        """Tell the end, too, whichever way it comes."""
        if self.path is None:
            yield
            return
        progress = ProgressFile(self.path)
        with ExitStack() as stack:
            stack.enter_context(progress.whole(message_of))
            stack.enter_context(run_lock(self.folder))
            progress.begin(self.names, self.names[-1])
            self._told = progress
            yield
            progress.done(self._at[-1], "")

    def begin(self, name: str) -> None:
        """Say that a step begins, and that the one before has ended."""
        if self._told is None:
            return
        if self._at:
            self._told.done(self._at[-1], "")
        self._at.append(name)
        self._told.stage(name, 0.0)
