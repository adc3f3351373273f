"""Fixture: a running print of a workspace, on a printer behind a pseudo-terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from printctl.machine.process.clients.client import PrintClient
from printctl.machine.process.clients.starting import start_print
from printctl.machine.process.orders import Order
from printctl.machine.records.states import LinkState
from tests.printctl.machine.link.fake_marlin import FakeMarlin, pty_printer, write_job
from tests.printctl.machine.link.jobs import quick_profile

LINES = 12_000
PACE_S = 0.025
"""For each answer: a print that lasts five minutes and leaves the processor to the test."""


@dataclass(frozen=True)
class UnderWay:
    """A print that goes on, and its printer."""

    client: PrintClient
    printer: FakeMarlin
    folder: Path


@contextmanager
def under_way(workspace: Path, run: str = "heart") -> Iterator[UnderWay]:
    """Print ``run`` of a workspace; whatever is left of it is killed at last."""
    folder = workspace / "runs" / run
    folder.mkdir(parents=True, exist_ok=True)
    write_job(folder / "part.gcode", LINES)
    with pty_printer(FakeMarlin(), pace_s=PACE_S) as served:
        client = start_print(
            Order(folder / "part.gcode", quick_profile(workspace), served.name, folder / "print")
        )
        try:
            yield UnderWay(client, served.printer, folder / "print")
        finally:
            if not client.status.ended:
                client.kill()
                client.wait(20)
            client.detach()


def soon(truth: Callable[[], bool], limit_s: float = 20.0) -> bool:
    """Wait until something is so; whether it came to be."""
    limit = time.monotonic() + limit_s
    while not truth():
        if time.monotonic() > limit:
            return False
        time.sleep(0.02)
    return True


def ended_by_kill(print_: UnderWay) -> bool:
    """Whether M112 was on the wire, and the print ended by it."""
    return print_.client.wait(20).state is LinkState.KILLED and print_.printer.halted
