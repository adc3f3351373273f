"""Two-head prints: pause, stop, syringe change, and resumption after the host's death."""

from __future__ import annotations

import numpy as np
import pytest

from printctl.machine.link.care import Care, NewSyringe
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.heads import head_at
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.recovering import plan_recovery
from printctl.machine.link.reloading import plan_head_reloads, plunger_travel
from printctl.machine.link.retreat import Retreat, heaters_off
from printctl.machine.link.states import LinkState
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Arming, Script, doomed, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated_transport import HostDiedError
from tests.printctl.machine.link.two_heads import (
    DATA,
    FORESEEN,
    JOB,
    QUICK,
    START,
    assert_same_print,
    job_of,
    machine,
    strokes,
)
from tests.slower import first_of

RETREAT = Retreat(relief_mm=0.005, others=(Retreat(relief_mm=0.002),))


def went_on(folder, printer, clock, script=None, **more):
    """Resume in the folder until the print is done; anew where no line of the job had left."""
    transport = SimTransport(printer, clock)
    history = read_journal(folder / "journal.log")
    if not history.begun:  # `resumable` refuses it
        (folder / "journal.log").unlink()
        history = None
    return played(
        DATA, folder, transport, script or Script(), history=history, printer=QUICK,
        retreat=RETREAT, **more,
    )  # fmt: skip


# --- what is read and said -------------------------------------------------------------------


# --- whole prints -----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", first_of(range(60), 6))
def test_a_host_killed_at_any_moment_goes_on_with_the_same_head(tmp_path, seed):
    rng = np.random.default_rng(seed)
    printer, clock = machine()
    last, part = int(rng.integers(1, 2 * len(JOB))), float(rng.choice([0.0, rng.uniform(), 1.0]))
    transport = doomed(printer, clock, last, part)
    try:
        status = played(DATA, tmp_path, transport, Script(), printer=QUICK, retreat=RETREAT)
    except HostDiedError:
        if seed % 3 == 0:  # somebody took the other head meanwhile
            printer.exchange(b"T0 S1\n" if printer.machine.motion.tool else b"T1 S1\n")
            printer.take_output()
        status = went_on(tmp_path, printer, clock)
    assert status.state is LinkState.DONE, status
    assert_same_print(printer.executed())


def test_a_stop_leaves_with_the_head_in_use_relieved(tmp_path):
    printer, clock = machine()
    first = JOB.lines.index(b"T1 S1")
    when = next(k for k in range(first, len(JOB)) if b" E" in JOB.lines[k] and b"X" in JOB.lines[k])

    class Watched(SimTransport):
        def write(self, data):
            super().write(data)
            if script.streamer.status.lines_done >= when + 2:
                script.streamer.stop()

    script = Script()
    transport = Watched(printer, clock)
    status = played(DATA, tmp_path, transport, script, printer=QUICK, retreat=RETREAT)
    assert status.state is LinkState.STOPPED
    done = printer.executed()
    pulled = done.plunger_end - done.plunger_start
    assert done.tool[pulled < 0][-1] == 1
    assert pulled[pulled < 0][-1] == pytest.approx(-0.002, abs=2e-4)
    assert done.end[-1, 2] > done.end[-3, 2]


def test_every_head_s_heater_goes_off():
    assert heaters_off(QUICK.model_copy(update={"safe_state_on": ()})) == [
        b"M104 T0 S0",
        b"M104 T1 S0",
        b"M140 S0",
    ]


def test_a_firmware_built_for_one_extruder_is_refused_before_the_first_line(tmp_path):
    one = MarlinPrinter(QUICK.model_copy(update={"heads": ()}), START)
    transport = SimTransport(one, VirtualClock())
    status = played(DATA, tmp_path, transport, Script(), printer=QUICK)
    assert (status.state, status.error) == (LinkState.FAILED, "HandshakeError")
    assert "built for 1 (EXTRUDER_COUNT)" in status.message
    assert len(one.executed()) == 0


# --- change of syringe ---------------------------------------------------------------------------


def change(streamer):
    """Drive the plunger of the head whose syringe is changed, then say it is done."""
    if not streamer.status.waits_for.startswith("syringe "):
        streamer.resume()
        return
    streamer.command(b"G1 E-2 F60", lambda said: None)
    streamer.command(b"M400", lambda said: streamer.resume(NewSyringe()))


def test_the_syringe_of_the_idle_head_is_changed_without_a_stroke_of_the_other(tmp_path):
    reloads = [mark.index for mark in JOB.marks.of(MarkKind.RELOAD)]
    plan = {
        index: head for index in reloads for head in (0, 1) if head_at(JOB.lines, index) == 1 - head
    }
    care = Care(reload_at=tuple(plan), reload_heads=tuple(plan.values()))
    assert {0, 1} == set(plan.values())
    printer, clock = machine()
    script = Script(on_paused=change)
    transport = SimTransport(printer, clock)
    status = played(DATA, tmp_path, transport, script, care=care, printer=QUICK, retreat=RETREAT)
    assert status.state is LinkState.DONE, status
    assert len([one for one in script.pauses if "head " in one.message]) == len(plan)
    assert_same_print(printer.executed())


@pytest.mark.parametrize("seed", first_of(range(30), 8))
def test_a_host_killed_while_a_syringe_is_changed(tmp_path, seed):
    rng = np.random.default_rng(200 + seed)
    reloads = [mark.index for mark in JOB.marks.of(MarkKind.RELOAD)]
    index, head = int(rng.choice(reloads)), int(rng.integers(2))
    care = Care(reload_at=(index,), reload_heads=(head,))
    printer, clock = machine()
    transport = SimTransport(printer, clock)
    script = Arming(transport, int(rng.integers(1, 24)), float(rng.uniform()), on_paused=change)
    try:
        status = played(
            DATA, tmp_path, transport, script, care=care, printer=QUICK, retreat=RETREAT
        )
    except HostDiedError:
        again = Script(on_paused=change)
        status = went_on(tmp_path, printer, clock, again, care=care)
    assert status.state is LinkState.DONE, status
    assert_same_print(printer.executed())


def test_reloads_are_planned_for_each_head_where_its_own_syringe_ends():
    job = parse_job(job_of((0, 1, 0, 1, 0, 1, 0, 1), ul=10.0), "test.gcode", QUICK)
    travel = [plunger_travel(job.lines, head) for head in (0, 1)]
    passes = [max(one) / 4 for one in travel]
    at, heads = plan_head_reloads(job, (2.2 * passes[0], 3.2 * passes[1]))
    assert sorted(heads) == [0, 1]
    assert list(at) == sorted(set(at))
    for index, head in zip(at, heads, strict=True):
        most = (2.2, 3.2)[head] * passes[head]
        assert max(travel[head][: index + 1]) <= most
        assert max(travel[head]) - travel[head][index] <= most
    none, _ = plan_head_reloads(job, (0.0, 100.0))
    assert none == ()


def test_a_firmware_that_doesn_t_take_the_head_is_not_moved(tmp_path):
    printer, clock = machine()
    at = next(k for k, line in enumerate(JOB.lines) if line == b"T1 S1") + 6
    transport = doomed(printer, clock, 2 * at + 20, 1.0)
    with pytest.raises(HostDiedError):
        played(DATA, tmp_path, transport, Script(), printer=QUICK, retreat=RETREAT)
    printer.firmware.take_tool = lambda command: None  # as a build with one extruder: silence
    before = printer.machine.motion.planner["position"][0].tolist()
    status = went_on(tmp_path, printer, clock)
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "doesn't say that it uses head" in status.message
    assert printer.machine.motion.planner["position"][0].tolist() == before


# --- after a power cut -------------------------------------------------------------------------


@pytest.mark.parametrize("part", [0.3, 0.5, 0.8])
def test_the_rest_of_a_job_is_printed_by_the_same_heads(tmp_path, part):
    first = int(part * len(JOB))
    mark = JOB.marks.next(MarkKind.VESSEL, first)
    begin = mark.index
    history = read_journal_of(tmp_path)
    found = plan_recovery(JOB, DATA, history, QUICK, RETREAT, from_line=JOB.file_lines[begin])
    run = dry_run(found.gcode, QUICK, START)
    assert not [one for one in run.findings if one.code != "plunger_travel"], run.findings
    rest, whole = strokes(run.executed), strokes(FORESEEN)
    written = whole[whole[:, 7] > 0]
    ours = rest[rest[:, 7] > 0]
    np.testing.assert_allclose(ours[:, :7], written[-len(ours) :, :7], atol=1e-9)
    np.testing.assert_allclose(ours[:, 7], written[-len(ours) :, 7], atol=1.01 / 6400)
    text = found.gcode.decode()
    assert text.index("M280 P0 S90") < text.index("G0 Z")
    assert text.index("M280 P1 S90") < text.index("G0 Z")
    assert "M218 T1 X0 Y0 Z0" in text


def read_journal_of(folder):
    printer, clock = machine()
    played(DATA, folder, SimTransport(printer, clock), Script(), printer=QUICK)
    return read_journal(folder / "journal.log")
