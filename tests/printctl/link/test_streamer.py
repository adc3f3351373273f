"""The streamer against a small Marlin, in virtual time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firmware_profiles import Printer, load
from printctl.link.channel import Wiring
from printctl.link.clock import VirtualClock
from printctl.link.job import Job, parse_job
from printctl.link.journal import Journal, read_journal
from printctl.link.protocol_marlin import MarlinProtocol
from printctl.link.states import LinkState, Status
from printctl.link.streamer import Streamer
from tests.printctl.link.fake_marlin import FakeMarlin, FakeTransport, zigzag


def job_of(lines: list[bytes]) -> Job:
    return parse_job(b"\n".join(lines), "test.gcode")


def streamer_of(
    job: Job, transport: FakeTransport, path: Path, seen: list[Status] | None = None
) -> Streamer:
    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=Journal(path / "journal.log"),
        printer=load(Printer, "generic_marlin"),
        on_status=seen.append if seen is not None else lambda status: None,
    )
    return Streamer(wiring, job)


def handshake_and(printer: FakeMarlin) -> list[str]:
    """What was executed under a number after the handshake's last command."""
    return printer.numbered[printer.numbered.index("M92") + 1 :]


def test_executes_every_line_once_and_in_order(tmp_path):
    printer, clock = FakeMarlin(), VirtualClock()
    lines = [b"G92 E0", *zigzag(300)]
    status = streamer_of(job_of(lines), FakeTransport(printer, clock), tmp_path).run()
    assert status.state is LinkState.DONE
    assert handshake_and(printer) == [line.decode() for line in lines] + ["M400"]
    history = read_journal(tmp_path / "journal.log")
    assert history.done == len(lines)
    assert history.state is LinkState.DONE


@pytest.mark.parametrize("seed", range(20))
def test_noise_and_lost_oks_neither_lose_nor_double_a_line(tmp_path, seed):
    rng = np.random.default_rng(seed)
    printer, clock = FakeMarlin(), VirtualClock()
    lines = zigzag(400)
    transport = FakeTransport(printer, clock, rng, noise=0.0004, drop_ok=0.003)
    status = streamer_of(job_of(lines), transport, tmp_path).run()
    assert status.state is LinkState.DONE, status
    assert handshake_and(printer)[: len(lines)] == [line.decode() for line in lines]
