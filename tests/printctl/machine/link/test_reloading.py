"""Syringe change during a print: planned, made, interrupted by the host's death."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printctl.machine.link.care import Care, NewSyringe
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.errors import LinkError
from printctl.machine.link.journal import read_records
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.reloading import plan_reloads, plunger_travel
from printctl.machine.link.requests import Request
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from sim.devices.families.marlin.printer import MarlinPrinter
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Arming, Script, doomed, layered, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import (
    PRINTER,
    START,
    assert_same_strokes,
    foreseen,
    wire,
)
from tests.printctl.machine.link.simulated_transport import HostDiedError
from tests.slower import first_of

DATA = layered(4, 20)
JOB = parse_job(DATA, "test.gcode")
FORESEEN = foreseen(DATA)


def change(streamer: Streamer) -> None:
    """Drive the plunger back for a new syringe and forward to its ink, then say so."""
    if streamer.status.waits_for != "syringe":
        streamer.resume()
        return
    streamer.command(b"G1 E-20 F60", lambda lines: None)
    streamer.command(b"G1 E-17.5 F60", lambda lines: streamer.resume(NewSyringe(2.5)))


def test_plunger_goes_on_from_the_new_syringe_exactly_as_in_the_job(tmp_path):
    at_second = JOB.marks.of(MarkKind.RELOAD)[1].index
    transport = wire()
    status = played(
        DATA, tmp_path, transport, script := Script(on_paused=change), Care(reload_at=(at_second,))
    )
    assert status.state is LinkState.DONE, status
    assert [one.lines_done for one in script.pauses] == [at_second]
    assert "change the syringe" in script.pauses[0].message
    motion = transport.printer.executed()
    assert_same_strokes(motion, FORESEEN)
    assert motion.end[:, 2].max() == 70.5  # parked: 60 mm above where it was
    history = read_journal(tmp_path / "journal.log")
    assert history.reloaded == at_second
    assert history.reload is None


def test_resuming_without_a_word_about_the_syringe_is_refused(tmp_path):
    refused = []

    def first_without(streamer: Streamer) -> None:
        if not refused:
            with pytest.raises(LinkError, match="paused for a change of syringe"):
                streamer.resume()
            refused.append(True)
            streamer.parts.queue.add(Request.RESUME)  # the printer's own button
        else:
            assert "not resumed" in streamer.status.message
            streamer.resume(unchanged=True)

    at = JOB.marks.of(MarkKind.RELOAD)[0].index
    transport = wire()
    status = played(
        DATA, tmp_path, transport, Script(on_paused=first_without), Care(reload_at=(at,))
    )
    assert status.state is LinkState.DONE
    motion = transport.printer.executed()
    assert_same_strokes(motion, FORESEEN)
    assert motion.plunger_end[-1] == FORESEEN.plunger_end[-1]


def test_change_that_was_not_begun_is_refused(tmp_path):
    said = []

    def on_paused(streamer: Streamer) -> None:
        with pytest.raises(LinkError, match="`printctl reload RUN` first"):
            streamer.resume(NewSyringe())
        said.append(streamer.status.message)
        streamer.resume()

    script = Script(on_paused=on_paused)
    transport = wire()
    pausing(transport, script, lambda streamer: streamer.pause())
    assert played(DATA, tmp_path, transport, script).state is LinkState.DONE
    assert said


def pausing(transport: SimTransport, script: Script, request) -> None:
    """Ask once, in mid-layer."""
    read, requested = transport.read, []

    def reading(timeout: float) -> bytes:
        streamer = script.streamer
        if not requested and streamer is not None and streamer.status.lines_done > 30:
            requested.append(True)
            request(streamer)
        return read(timeout)

    transport.read = reading  # type: ignore[method-assign]


def test_pause_becomes_a_change_of_syringe_where_it_stands(tmp_path):
    def on_paused(streamer: Streamer) -> None:
        if streamer.status.waits_for == "syringe":
            change(streamer)
        else:
            streamer.reload()

    script = Script(on_paused=on_paused)
    transport = wire()
    pausing(transport, script, lambda streamer: streamer.pause())
    assert played(DATA, tmp_path, transport, script).state is LinkState.DONE
    assert len(script.pauses) == 2
    assert_same_strokes(transport.printer.executed(), FORESEEN)


def test_syringe_that_does_not_last_to_the_next_reload_point_is_not_gone_on_with(tmp_path):
    said = []

    def on_paused(streamer: Streamer) -> None:
        said.append(streamer.status.message)
        streamer.resume(NewSyringe(0.95 if len(said) == 1 else 0.5))

    at = JOB.marks.of(MarkKind.RELOAD)[0].index
    transport = wire()
    care = Care(reload_at=(at,), capacity_mm=1.0)
    script = Script(on_paused=on_paused)
    status = played(DATA, tmp_path, transport, script, care)
    assert status.state is LinkState.DONE
    assert "the syringe has 0.05 mm left" in said[1]
    assert_same_strokes(transport.printer.executed(), FORESEEN)


@pytest.mark.parametrize("part", first_of([0.6, 0.0, 1.0]))
@pytest.mark.parametrize("last", range(1, 22))
def test_host_killed_in_the_middle_of_a_change_goes_on_exactly(tmp_path, last, part):
    at = JOB.marks.of(MarkKind.RELOAD)[1].index
    printer, clock, care = MarlinPrinter(PRINTER, START), VirtualClock(), Care(reload_at=(at,))
    transport = SimTransport(printer, clock)
    script = Arming(transport, last, part, on_paused=change)
    died = False
    try:
        status = played(DATA, tmp_path, transport, script, care)
    except HostDiedError:
        died = True
        # Dies again soon after it was begun again.
        with pytest.raises(HostDiedError):
            again(tmp_path, doomed(printer, clock, 1 + last % 5, part), care)
        status = again(tmp_path, SimTransport(printer, clock), care)
    assert died or last > 15
    assert status.state is LinkState.DONE, status
    assert_same_strokes(printer.executed(), FORESEEN)


@pytest.mark.parametrize("planned", [True, False], ids=["planned", "asked for"])
@pytest.mark.parametrize("last", [1, 2, 4, 7, 9])
def test_a_change_isnt_forgotten_where_the_host_died_before_there_was_room_for_it(
    tmp_path, last, planned
):
    at = JOB.marks.of(MarkKind.RELOAD)[1].index
    care = Care(reload_at=(at,)) if planned else Care()
    printer, clock = MarlinPrinter(PRINTER, START), VirtualClock()
    transport = SimTransport(printer, clock)
    script = Arming(transport, last, 0.0, on_paused=change)
    if not planned:
        pausing(transport, script, lambda streamer: streamer.reload())
    with pytest.raises(HostDiedError):
        played(DATA, tmp_path, transport, script, care)
    assert again(tmp_path, SimTransport(printer, clock), care).state is LinkState.DONE
    told = [record for record in read_records(tmp_path / "journal.log") if record]
    changes = [record["done"] for record in told if record["t"] == "syringe"]
    assert len(changes) == 1
    assert changes[0] in [mark.index for mark in JOB.marks.of(MarkKind.RELOAD)]
    assert_same_strokes(printer.executed(), FORESEEN)


def test_a_change_that_was_taken_back_is_wanted_no_more(tmp_path):
    script, transport = Script(), wire()
    pausing(transport, script, lambda streamer: (streamer.reload(), streamer.resume()))
    assert played(DATA, tmp_path, transport, script).state is LinkState.DONE
    assert not script.pauses
    assert read_journal(tmp_path / "journal.log").wanted is None


def test_a_new_syringe_isnt_taken_while_room_is_being_made_for_it(tmp_path):
    refused = []

    def while_pausing(status: Status) -> None:
        if status.state is LinkState.PAUSING and script.streamer is not None:
            with pytest.raises(LinkError, match="isn't paused"):
                script.streamer.resume(NewSyringe())
            refused.append(status.state)

    script = Watching(while_pausing, on_paused=change)
    transport = wire()
    care = Care(reload_at=(JOB.marks.of(MarkKind.RELOAD)[0].index,))
    assert played(DATA, tmp_path, transport, script, care).state is LinkState.DONE
    assert refused


class Watching(Script):
    """A script that is shown each status as well."""

    def __init__(self, show: Callable[[Status], None], **said: Any) -> None:
        super().__init__(**said)
        self.show = show

    def status(self, status: Status) -> None:
        self.show(status)
        super().status(status)


def again(folder: Path, transport: SimTransport, care: Care) -> Status:
    history = read_journal(folder / "journal.log")
    return played(DATA, folder, transport, Script(on_paused=change), care, history=history)


@given(
    layers=st.lists(st.floats(0.1, 2.99), min_size=1, max_size=12),
    capacity=st.floats(3.0, 8.0),
    used=st.floats(0.0, 2.9),
)
@settings(deadline=None)
def test_reloads_are_the_fewest_and_each_stretch_fits(layers, capacity, used):
    text, e = ["G92 E0"], 0.0
    for k, push in enumerate(layers):
        e += push
        text += [f"G1 X{k} E{e:.5f}", ";RELOAD", f"G92 E{e - 1:.5f}" if k % 3 == 2 else "M105"]
        e -= k % 3 == 2
    job = parse_job("\n".join(text).encode(), "a")
    travel = plunger_travel(job.lines)
    np.testing.assert_allclose(travel[-1], sum(layers), atol=1e-3)
    total = sum(layers)
    try:
        chosen = plan_reloads(job, capacity, used)
    except LinkError:
        assert layers[0] > capacity - used - 1e-3
        return
    ends = [0, *chosen, len(job)]
    room = [capacity - used, *[capacity] * len(chosen)]
    for begin, end, left in zip(ends, ends[1:], room, strict=False):
        assert travel[end] - travel[begin] <= left + 1e-3
    least = max(0, int(np.ceil((total - capacity + used) / capacity - 1e-6)))
    assert len(chosen) >= least
    if total <= capacity - used - 1e-3:
        assert chosen == ()


def test_stretch_without_a_reload_point_is_named():
    job = parse_job(b"G92 E0\nG1 X1 E3\n;RELOAD\nG1 X2 E9\nG1 X3 E10\n;RELOAD\nG1 X1 E11\n", "a")
    with pytest.raises(LinkError, match=r"lines 4 to 5 of a push the plunger by 7\.00 mm"):
        plan_reloads(job, 5.0)
    assert plan_reloads(job, 7.0) == (2, 4)
