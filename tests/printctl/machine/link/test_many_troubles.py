"""Random sequences of pauses, syringe changes and host deaths in one print."""

from __future__ import annotations

import numpy as np
import pytest

from printctl.machine.link.care import Care, NewSyringe
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import (
    PRINTER,
    START,
    Script,
    doomed,
    layered,
    played,
)
from tests.printctl.machine.link.simulated_transport import HostDiedError
from tests.slower import first_of

DATA = layered(5, 20)
JOB = parse_job(DATA, "test.gcode")
FORESEEN = dry_run(DATA, PRINTER, START, cold_extrusion=True).executed


class Restless(Script):
    """A user who asks for something at random whenever there is news."""

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__(on_paused=self.go_on)
        self._rng, self._left = rng, 6

    def status(self, status: Status) -> None:
        super().status(status)
        streamer = self.streamer
        if streamer is None or status.state is not LinkState.PRINTING or self._left == 0:
            return
        if self._rng.random() < 0.3 and status.lines_done < JOB.marks.all[-3].index:
            self._left -= 1
            request = self._rng.choice(["now", "layer", "reload"])
            if request == "now":
                streamer.pause()
            elif request == "layer":
                streamer.pause(MarkKind.LAYER)
            else:
                streamer.reload()

    def go_on(self, streamer: Streamer) -> None:
        if streamer.status.waits_for != "syringe":
            if self._rng.random() < 0.3:
                streamer.reload()
            else:
                streamer.resume()
        elif self._rng.random() < 0.2:
            streamer.resume(unchanged=True)
        else:
            back = float(self._rng.uniform(-30.0, -5.0))
            streamer.command(b"G1 E%.3f F60" % back, lambda lines: None)
            streamer.command(
                b"G1 E%.3f F60" % (back + 2.0), lambda lines: streamer.resume(NewSyringe(1.0))
            )


@pytest.mark.parametrize("seed", first_of(range(25), 3))
def test_print_with_every_trouble_is_the_same_print(tmp_path, seed):
    rng = np.random.default_rng(seed)
    printer, clock, deaths = MarlinPrinter(PRINTER, START), VirtualClock(), 0
    care = Care(checkpoint_s=0.0, reload_at=(JOB.marks.of(MarkKind.RELOAD)[2].index,))
    script = Restless(rng)
    while True:
        last, part = int(rng.integers(20, 90)), rng.random()
        transport = doomed(printer, clock, last if deaths < 5 else 0, part)  # 0: lives on
        path = tmp_path / "journal.log"
        history = read_journal(path) if deaths else None
        if history is not None and not history.begun:
            history = None
        try:
            status = played(DATA, tmp_path, transport, script, care, history=history)
            break
        except HostDiedError:
            deaths += 1
    assert status.state is LinkState.DONE, status
    assert deaths >= 1
    motion = printer.executed()
    across = np.any(motion.start[:, :2] != motion.end[:, :2], axis=1)
    expected = np.any(FORESEEN.start[:, :2] != FORESEEN.end[:, :2], axis=1)
    np.testing.assert_array_equal(motion.start[across], FORESEEN.start[expected])
    np.testing.assert_array_equal(motion.end[across], FORESEEN.end[expected])
    pushed = (motion.plunger_end - motion.plunger_start)[across]
    wanted = (FORESEEN.plunger_end - FORESEEN.plunger_start)[expected]
    np.testing.assert_allclose(pushed, wanted, atol=1e-9)
