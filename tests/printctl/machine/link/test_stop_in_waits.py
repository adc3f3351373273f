"""Stop during a wait of the link itself, on the simulated Marlin: motor behaviour."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from firmware_profiles import Printer, load
from printctl.machine.link.care import NewSyringe
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.families import protocol_for
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from sim.devices.families.registry import simulated_printer
from sim.gcode.motion.executed import ExecutedMotion
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import wired

MARLIN = load(Printer, "generic_marlin")
HEADER = "M302 P1\nG90\nM82\nM85 S600\nG92 X50 Y50 Z10 E0\n"
JOB = HEADER + "".join(f"G1 X{20 + 20 * (k % 2)} E{k / 10:.1f} F1200\n" for k in range(1, 41))
PAUSE_LINE = 25
SLICE_S = 0.005
RETREAT = Retreat(relief_mm=0.3, prime_mm=0.2)


@dataclass(frozen=True)
class Moment:
    """When somebody stops: so long after the link has written a text for the so-manieth time."""

    text: bytes
    after_s: float
    count: int = 1
    in_state: LinkState | None = None


class Stopping(SimTransport):
    """A wire at which a person watches what is written, and stops at a moment."""

    moment: Moment
    streamer: Streamer
    seen = 0
    due_s = np.inf
    asked_s = np.inf

    def write(self, data: bytes) -> None:
        super().write(data)
        state = self.streamer.status.state
        if self.moment.text in data and self.moment.in_state in (None, state):
            self.seen += 1
            if self.seen == self.moment.count:
                self.due_s = self.clock.now() + self.moment.after_s

    def read(self, timeout: float) -> bytes:
        """Let printer and person live through the time, never the printer ahead of the person."""
        end, data = self.clock.now() + timeout, b""
        while not data and self.clock.now() < end and self.clock.now() < self.due_s:
            self.clock.move_to(min(self.clock.now() + SLICE_S, end, self.due_s))
            self.printer.run_to(self.clock.now())
            data = self.printer.take_output()
        if self.clock.now() >= self.due_s:
            self.asked_s, self.due_s = self.clock.now(), np.inf
            self.streamer.stop()
        return data


def stopped(
    moment: Moment, folder: Path, printer: Printer = MARLIN, job: str = JOB, reload: bool = False
) -> tuple[Status, Stopping]:
    """Print, pause after some lines, resume at once, and stop at ``moment``."""
    wire = Stopping(simulated_printer(printer)(printer, (50.0, 50.0, 10.0)), VirtualClock())
    wire.moment, asked = moment, list[LinkState]()

    def once(status: Status, state: LinkState) -> bool:
        new = status.state is state and state not in asked
        asked.extend([state] if new else [])
        return new

    def on_status(status: Status) -> None:
        if status.lines_done >= PAUSE_LINE and once(status, LinkState.PRINTING):
            streamer.pause()
        if once(status, LinkState.PAUSED):
            if reload:
                streamer.reload()
            else:
                streamer.resume()
        elif reload and status.waits_for == "syringe" and once(status, LinkState.CHECKING):
            streamer.resume(NewSyringe(plunger_mm=0.0))

    protocol = protocol_for(printer, wire.quiet_s)
    more = {"protocol": protocol, "on_status": on_status, "retreat": RETREAT}
    streamer = wire.streamer = wired(wire, folder, job.encode(), printer, **more)
    return streamer.run(), wire


def after(motion: ExecutedMotion, at_s: float) -> np.ndarray:
    """Which moves were still made after a moment, but for what began before."""
    return motion.time_end > at_s


def assert_stands(wire: Stopping, within_s: float) -> ExecutedMotion:
    """Nothing sideways, nothing downwards and nothing pushed once so much time is over."""
    motion = wire.printer.executed()
    late = after(motion, wire.asked_s + within_s)
    assert np.array_equal(motion.start[late][:, :2], motion.end[late][:, :2])
    assert (motion.end[late][:, 2] >= motion.start[late][:, 2]).all()
    assert (motion.plunger_end[late] <= motion.plunger_start[late] + 1e-9).all()
    return motion


PAUSING = Moment(b"M0400", 1.3)
LOWERING = Moment(b"G1 Z", 0.15, count=4)
PRIMING = Moment(b"G1 E", 0.2, count=2)


@pytest.mark.parametrize("parser", [True, False])
@pytest.mark.parametrize("moment", [PAUSING, LOWERING, PRIMING], ids=["pause", "down", "prime"])
def test_motors_stand_at_once_in_each_wait(tmp_path, moment, parser):
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    status, wire = stopped(moment, tmp_path, printer)
    assert (status.state, status.position_known) == (LinkState.STOPPED, True), status
    motion = assert_stands(wire, 0.15)
    assert motion.end[-1, 2] == pytest.approx(30.0)  # up by 20 mm, from wherever it was


@pytest.mark.parametrize("moment", [PAUSING, LOWERING], ids=["pause", "down"])
def test_the_plunger_is_relieved_once(tmp_path, moment):
    """By the same amount whether the pause had relieved it before or not."""
    _, wire = stopped(moment, tmp_path)
    motion = wire.printer.executed()
    most = motion.plunger_end.max()
    assert motion.plunger_end[-1] == pytest.approx(most - RETREAT.relief_mm, abs=0.002)


def test_a_syringe_that_is_changed_keeps_its_plunger(tmp_path):
    moment = Moment(b"G1 Z70", 0.5)
    status, wire = stopped(moment, tmp_path, reload=True)
    assert status.state is LinkState.STOPPED
    motion = assert_stands(wire, 5.0)
    moved = np.flatnonzero(motion.plunger_end != motion.plunger_start)
    assert motion.time_end[moved[-1]] < wire.asked_s


def test_a_wait_for_heat_is_ended(tmp_path):
    job = JOB + "M109 S40\n" + "G1 X20 E9 F1200\n"
    status, wire = stopped(Moment(b"M109", 2.0), tmp_path, job=job)
    assert status.state is LinkState.STOPPED
    assert wire.clock.now() - wire.asked_s < 15


@pytest.mark.parametrize("parser", [True, False])
def test_a_stop_in_the_last_wait_drops_the_last_moves(tmp_path, parser):
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    moment = Moment(b"M0400", 1.3, in_state=LinkState.PRINTING)
    status, wire = stopped(moment, tmp_path, printer)
    assert status.state is LinkState.STOPPED, status
    assert_stands(wire, 0.15)
    assert status.lines_done == status.lines_total > status.lines_executed


@pytest.mark.parametrize("parser", [True, False])
@pytest.mark.parametrize("in_flight", [1, 2])
def test_a_line_that_waits_for_room_isnt_made(tmp_path, parser, in_flight):
    printer = MARLIN.model_copy(update={"emergency_parser": parser, "lines_in_flight": in_flight})
    status, wire = stopped(Moment(b"G1 X", 0.4, count=20), tmp_path, printer)
    assert status.state is LinkState.STOPPED, status
    assert_stands(wire, 0.15)


def test_a_firmware_without_quickstop_comes_down_no_further_than_the_step_in_hand(tmp_path):
    duet = load(Printer, "makergear_m2_duet2")
    job = JOB.replace("M85 S600\n", "")
    moment = Moment(b"G1 Z", 0.15, count=4)
    status, wire = stopped(moment, tmp_path, duet, job)
    assert status.state is LinkState.STOPPED, status
    assert_stands(wire, 0.7)  # 2 mm at 5 mm/s, and its beginning and end


# --- stop during an arc: Marlin continues generating segments after M410
CIRCLES = HEADER + "G3 X90 Y50 I20 J0 E0.5 F900\nG3 X50 Y50 I-20 J0 E1.0 F900\n" * 2
MIDDLE, RADIUS_MM = np.array([70.0, 50.0]), 20.0


@pytest.mark.parametrize("parser", [True, False])
@pytest.mark.parametrize("after_s", [0.4, 1.5, 3.0])
def test_a_stop_in_an_arc_never_leaves_the_arc(tmp_path, after_s, parser):
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    status, wire = stopped(Moment(b"G3 X50", after_s), tmp_path, printer, job=CIRCLES)
    assert (status.state, status.position_known) == (LinkState.STOPPED, True), status
    motion = wire.printer.executed()
    across = np.any(motion.start[:, :2] != motion.end[:, :2], axis=1)
    middles = (motion.start[across, :2] + motion.end[across, :2]) / 2
    away = np.linalg.norm(middles - MIDDLE, axis=1) - RADIUS_MM
    assert np.abs(away).max() < 0.05
    stood = motion.end[across][-1, :2]
    assert np.linalg.norm(stood - [50.0, 50.0]) > 1.0  # the circle isn't made to its end


@pytest.mark.parametrize("parser", [True, False])
def test_nothing_is_begun_behind_the_arc(tmp_path, parser):
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    job = CIRCLES + "G1 X50 Y20 E1.2\n"
    _, wire = stopped(Moment(b"G1 X50", 0.0), tmp_path, printer, job=job)
    assert wire.printer.executed().end[:, 1].min() > 29.9
