"""Progress on stderr: a bar per stage on a terminal, a line per stage elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from time import monotonic
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


class Report(Protocol):
    """What a stage tells while it works."""

    def __call__(self, fraction: float, note: str = "") -> None:
        """Say how much is done (0 to 1) and, in a few words, what."""


class Listener(Protocol):
    """Who else is told of progress (`printctl.progress_file`)."""

    def begin(self, stages: Sequence[str], until: str) -> None:
        """Which stages there will be, and the last one that is asked for."""

    def stage(self, name: str, fraction: float, note: str = "") -> None:
        """How far a stage is, 0 to 1."""

    def done(self, name: str, note: str) -> None:
        """A stage has ended well."""

    def remark(self, name: str, text: str) -> None:
        """Something that the user should know about a stage."""


TOLD_AFTER_S, TOLD_EVERY_S, TOLD_SHARE = 10.0, 30.0, 0.05
"""Where no bar can be drawn, a line says how far a stage is: once this share more is done, at most
every so many seconds, or after the longer time in any case."""


def draws_bars(console: Console) -> bool:
    """Whether lines on the console can be drawn over: it is a terminal, and no dumb one."""
    return console.is_terminal and not console.is_dumb_terminal


class StageBars:
    """A progress bar for each stage as it runs."""

    def __init__(self, console: Console, listener: Listener | None = None) -> None:
        self._console = console
        self._listener = listener
        self._bars = Progress(
            TextColumn("{task.description:<14}"),
            BarColumn(bar_width=28),
            TimeElapsedColumn(),
            TextColumn("[dim]{task.fields[note]}"),
            console=console,
            disable=not draws_bars(console),
        )

    @contextmanager
    def all(self) -> Iterator[None]:
        """Keep the bars on the screen while the run lasts."""
        with self._bars:
            yield

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Take the bars off the screen, so that a question can be asked."""
        self._bars.stop()
        try:
            yield
        finally:
            self._bars.start()

    def ask(self, question: str) -> str:
        """Ask the user; take the bars off the screen before."""
        return self._console.input(question)

    @contextmanager
    def stage(self, name: str) -> Iterator[Report]:
        """A bar for one stage; it fills up when the stage ends well."""
        task = self._bars.add_task(name, total=None, note="")
        if self._listener is not None:
            self._listener.stage(name, 0.0)

        last_s, last = monotonic(), 0.0

        def report(fraction: float, note: str = "") -> None:
            nonlocal last_s, last
            due_s = TOLD_AFTER_S if fraction >= last + TOLD_SHARE else TOLD_EVERY_S
            if not draws_bars(self._console) and monotonic() >= last_s + due_s:
                last_s, last = monotonic(), fraction
                line = f"{name:<14} {fraction:.0%} {note}".rstrip()
                self._console.print(line, highlight=False, markup=False)
            if self._listener is not None:
                self._listener.stage(name, fraction, note)
            self._bars.update(task, total=1.0, completed=fraction, note=note)

        yield report
        self._bars.update(task, total=1.0, completed=1.0)

    def say(self, name: str, note: str) -> None:
        """Close a stage with a word about it."""
        if self._listener is not None:
            self._listener.done(name, note)
        for task in self._bars.tasks:
            if task.description == name:
                self._bars.update(task.id, note=note)
        if not draws_bars(self._console):
            self._console.print(f"{name:<14} {note}", highlight=False)

    def remark(self, name: str, text: str) -> None:
        """Something that the user should know about a stage; it stays on the screen."""
        if self._listener is not None:
            self._listener.remark(name, text)
        self._console.print(f"{name:<14} note: {text}", highlight=False, markup=False)
