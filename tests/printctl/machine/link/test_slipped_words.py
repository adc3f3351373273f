"""Lines garbled past the checksum: found by comparing positions."""

from __future__ import annotations

import re
from functools import reduce
from operator import xor

import numpy as np
import pytest

from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.slips import SOONEST_LINES
from printctl.machine.link.states import LinkState
from sim.devices.families.marlin.printer import MarlinPrinter
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER, START, gcode, printed
from tests.slower import first_of


class SlippingTransport(SimTransport):
    """From N300 on, once: an X becomes a Z on its way, and the checksum is right.

    No other noise garbles that line, else it is refused and nothing has slipped.
    """

    slipped = False
    _slip = b""

    def on_the_way(self, data: bytes) -> bytes:
        slip, self._slip = self._slip, b""
        return data if slip else super().on_the_way(data)

    def write(self, data: bytes) -> None:
        moves = re.match(rb"N(\d+) G1 X", data)
        if moves and int(moves[1]) >= 300 and not self.slipped:
            self.slipped = True
            body = data.split(b"*")[0].replace(b"X", b"Z")
            data = self._slip = b"%b*%d\n" % (body, reduce(xor, body))
        super().write(data)


@pytest.mark.parametrize("seed", first_of(range(6), 3))
def test_word_that_slipped_through_is_found_soon_on_a_noisy_line(tmp_path, seed):
    printer = MarlinPrinter(PRINTER, START)
    transport = SlippingTransport(
        printer, VirtualClock(), np.random.default_rng(seed), noise=0.0004, drop_ok=0.01
    )
    status, _ = printed(gcode(2000), tmp_path, transport)
    assert transport.slipped
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "Z is 5" in status.message
    assert status.lines_done < 340


class NoisyOnce(SimTransport):
    """Line 295 is garbled; the X of line 300 becomes a Z, and the checksum is right."""

    garbled = False
    lines = gcode(2000).splitlines()

    def write(self, data: bytes) -> None:
        if b" %b*" % self.lines[294] in data and not self.garbled:
            self.garbled, data = True, data.replace(b"G1", b"G3")
        if b" %b*" % self.lines[299] in data:
            body = data.split(b"*")[0].replace(b"X", b"Z")
            data = b"%b*%d\n" % (body, reduce(xor, body))
        super().write(data)


def test_height_that_slipped_ends_the_print_at_the_first_comparison(tmp_path):
    transport = NoisyOnce(MarlinPrinter(PRINTER, START), VirtualClock())
    status, _ = printed(gcode(2000), tmp_path, transport)
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "Z is 5" in status.message
    assert 300 <= status.lines_done <= 300 + 2 * SOONEST_LINES


class StrayingTransport(SimTransport):
    """One line in 31 goes to another X, and the checksum is right."""

    def write(self, data: bytes) -> None:
        if data.startswith(b"N") and int(data.split()[0][1:]) % 31 == 0:
            body = re.sub(rb" X\S+", b" X51.000", data.split(b"*")[0])
            data = b"%b*%d\n" % (body, reduce(xor, body))
        super().write(data)


def test_word_that_slipped_through_and_was_given_again_is_told(tmp_path):
    """Comparisons fall on a slipped line in some prints only; one that would stay ends others."""
    told = []
    for seed in range(5):
        folder = tmp_path / str(seed)
        folder.mkdir()
        printer, rng = MarlinPrinter(PRINTER, START), np.random.default_rng(seed)
        transport = StrayingTransport(printer, VirtualClock(), rng, noise=0.001)
        status, _ = printed(gcode(600), folder, transport)
        slipped = "X is 51.00 mm where the job says 5"
        assert status.state is LinkState.DONE or slipped in status.message
        alarms = read_journal(folder / "journal.log").alarms
        told += [text for text in alarms if "slipped through its checksum" in text]
    assert len(told) > 1
    assert all(slipped in text for text in told)


def test_clean_line_is_never_held_up_for_a_comparison(tmp_path):
    printer = MarlinPrinter(PRINTER, START)
    printed(gcode(600), tmp_path, SimTransport(printer, VirtualClock()))
    history = read_journal(tmp_path / "journal.log")
    assert history.checkpoint is not None
    assert history.checkpoint["done"] == history.done  # at the end alone
