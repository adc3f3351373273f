"""Pauses at any moment and at marks: every line once, in order, resumed at the exact point."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Syringe, load
from firmware_profiles.families.link_protocol import Timing
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.pairing import Pairing
from printctl.machine.control.requests import ResumeRequest
from printctl.machine.control.streamer import Streamer
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import Retreat
from printctl.machine.job.syringes import plan_reloads, plunger_travel
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.journal import read_records
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.dry_run.run import dry_run
from tests.design.toolpath.plans import embedded_toolpath, fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block, random_tree
from tests.printctl.machine.link.fake_marlin import FakeTransport
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Arming, Following, Script, doomed, layered, played
from tests.printctl.machine.link.protocols import made_protocol
from tests.printctl.machine.link.scripted_transport import ScriptedTransport
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import (
    PRINTER,
    START,
    assert_same_strokes,
    foreseen,
    wire,
)
from tests.printctl.machine.link.simulated_transport import HostDiedError
from tests.printctl.machine.link.test_families import FAKES, facts
from tests.slower import first_of


def followed(data, tmp_path, script, **options):
    """Print on the small Marlin; gives the status, the job and the printer."""
    job = parse_job(data, "test.gcode")
    printer = Following(job, script)
    transport = FakeTransport(printer, VirtualClock())
    return played(data, tmp_path, transport, script, **options), job, printer


def with_x(lines) -> list[str]:
    """Lines that the link never sends of its own accord."""
    return [line for line in lines if " X" in line]


REQUESTS = {
    "now": lambda streamer: streamer.pause(),
    "layer": lambda streamer: streamer.pause(MarkKind.LAYER),
    "reload": lambda streamer: streamer.reload(),
}


def change_or_resume(streamer: Streamer) -> None:
    changing = streamer.status.waits_for == "syringe"
    streamer.resume(NewSyringe() if changing else None)


def two_in_flight() -> MarlinProtocol:
    return MarlinProtocol(Timing(calm_lines=0), Pairing(128))


@pytest.mark.parametrize("protocol", [MarlinProtocol, two_in_flight])
@pytest.mark.parametrize("seed", first_of(range(10), 3))
def test_pauses_on_a_noisy_line_lose_and_double_nothing(tmp_path, seed, protocol):
    rng = np.random.default_rng(seed)
    job = parse_job(layered(6, 25), "test.gcode")
    moments = rng.choice(np.arange(6, len(job) - 40), size=4, replace=False).tolist()
    script = Script(on_paused=change_or_resume)
    script.at_line = {line: REQUESTS[rng.choice(list(REQUESTS))] for line in moments}
    printer = Following(job, script)
    transport = FakeTransport(printer, VirtualClock(), rng, noise=0.0004, drop_ok=0.005)
    status = played(
        layered(6, 25), tmp_path, transport, script, Care(checkpoint_s=0.0), protocol=protocol()
    )
    assert status.state is LinkState.DONE, status
    assert with_x(printer.numbered) == with_x(line.decode() for line in job.lines)


@pytest.mark.parametrize("firmware", FAKES)
def test_other_families_pause_and_change_the_syringe_as_well(tmp_path, firmware):
    data = layered(3, 20).replace(b"M302 P1\n", b"").replace(b"M85 S600\n", b"")
    job, fake, clock = parse_job(data, "a"), FAKES[firmware](), VirtualClock()
    script = Script(on_paused=change_or_resume)
    reloads = tuple(mark.index for mark in job.marks.of(MarkKind.RELOAD)[:1])
    status = played(
        data,
        tmp_path,
        ScriptedTransport(fake.receive, clock),
        script,
        Care(checkpoint_s=0.0, reload_at=reloads),
        protocol=made_protocol(firmware),
        printer=facts(firmware),
    )
    assert status.state is LinkState.DONE, status
    assert [one.lines_done for one in script.pauses] == list(reloads)
    assert not any(line.startswith("M84") for line in fake.executed)


def test_pause_after_what_the_job_does_not_mark_is_refused(tmp_path):
    refused = []

    def request(streamer: Streamer) -> None:
        with pytest.raises(LinkError, match="marks no end of a vessel after line 11"):
            streamer.pause(MarkKind.VESSEL)
        refused.append(True)

    status, _, _ = followed(layered(2, 20), tmp_path, Script(at_line={12: request}))
    assert refused
    assert status.state is LinkState.DONE


def test_pause_that_is_waited_for_can_be_taken_back(tmp_path):
    script = Script(at_line={12: REQUESTS["layer"], 14: lambda streamer: streamer.resume()})
    status, _, _ = followed(layered(3, 20), tmp_path, script)
    assert status.state is LinkState.DONE
    assert script.pauses == []


def test_long_pause_is_survived_although_the_firmware_switches_off_by_itself(tmp_path):
    transport, begun = wire(), []
    clock = transport.clock

    def wait_half_an_hour(streamer: Streamer) -> None:
        begun.append(clock.now())

    script = Script(on_paused=wait_half_an_hour)
    read = transport.read

    def reading(timeout: float) -> bytes:
        if script.streamer is not None and not begun and clock.now() > 4.0:
            script.streamer.pause()
        if begun and begun[0] + 1800 < clock.now() and script.streamer is not None:
            begun[0] = np.inf
            script.streamer.resume()
        return read(timeout)

    transport.read = reading  # type: ignore[method-assign]
    status = played(layered(4, 30), tmp_path, transport, script)
    assert status.state is LinkState.DONE, status
    assert clock.now() > 1800


def test_needle_that_was_pushed_aside_in_a_pause_stays_up(tmp_path):
    said: list[str] = []

    def push_then_return(streamer: Streamer) -> None:
        said.append(streamer.status.message)
        assert len(said) < 5
        if len(said) == 1:
            streamer.command(b"G1 X90", lambda lines: streamer.resume())
        else:
            last = job.lines[streamer.status.lines_done - 1]
            x = last.split(b"X")[1].split()[0]
            streamer.command(b"G1 X" + x, lambda lines: streamer.resume())

    data = layered(2, 20)
    script = Script(on_paused=push_then_return, at_line={12: REQUESTS["now"]})
    job = parse_job(data, "a")
    status, _, printer = followed(data, tmp_path, script)
    assert status.state is LinkState.DONE
    assert "not resumed: X is 90.00 mm" in said[1]
    aside = printer.numbered.index("G1 X90")
    down = next(k for k, line in enumerate(printer.numbered) if k > aside and " Z10.0" in line)
    assert sum(line.startswith("G1 X5") for line in printer.numbered[aside:down]) == 1


def test_extra_prime_is_pushed_and_not_counted(tmp_path):
    script = Script(at_line={12: REQUESTS["now"]})
    retreat = Retreat(relief_mm=0.1, prime_mm=0.05)
    status, job, printer = followed(layered(2, 20), tmp_path, script, retreat=retreat)
    assert status.state is LinkState.DONE
    last = job.lines[script.pauses[0].lines_done - 1]
    at = float(last.split(b"E")[1].split()[0])
    primed = printer.numbered.index(f"G1 E{at + 0.05:.5f} F30")
    assert printer.numbered[primed + 1] == f"G92 E{at:.5f}"


def test_deadman_pauses_at_the_next_mark_unless_somebody_confirms(tmp_path):
    data = layered(6, 150)
    clock = VirtualClock()
    job = parse_job(data, "a")
    for confirmed in (False, True):
        folder = tmp_path / str(confirmed)
        folder.mkdir()
        script = Script()
        printer = Following(job, script)
        if confirmed:
            script.at_line = {
                line: lambda streamer: streamer.alive() for line in range(1, len(job), 20)
            }
        status = played(
            data, folder, FakeTransport(printer, clock), script, care=Care(deadman_s=0.3)
        )
        assert status.state is LinkState.DONE
        marks = {mark.index for mark in job.marks.of(MarkKind.LAYER)}
        assert bool(script.pauses) is not confirmed
        assert {one.lines_done for one in script.pauses} <= marks
        assert all(one.deadman_left_s == 0.3 for one in script.pauses)
        assert script.seen[-2].deadman_left_s is not None
    alarms = read_journal(tmp_path / "False" / "journal.log").alarms
    assert any("nobody confirmed" in text for text in alarms)


def test_deadman_stops_a_job_without_marks_at_once_where_that_is_wanted(tmp_path):
    data = b"\n".join(line for line in layered(1, 2000).split(b"\n") if not line.startswith(b";"))
    care = Care(deadman_s=0.5, deadman_stops=True)
    status, job, _ = followed(data, tmp_path, Script(), care=care)
    assert status.state is LinkState.STOPPED
    assert "nobody confirmed" in status.message
    assert 0 < status.lines_done < len(job)
    assert status.position_known


@pytest.mark.parametrize(("every", "expected"), [(0.0, 6), (0.4, 2), (None, 0)])
def test_checkpoints_are_made_at_marks_as_often_as_asked(tmp_path, every, expected):
    data = layered(6, 300)
    status, job, printer = followed(data, tmp_path, Script(), care=Care(checkpoint_s=every))
    assert status.state is LinkState.DONE
    history = read_journal(tmp_path / "journal.log")
    made = [record["done"] for record in history.checkpoints]
    assert set(made) <= {mark.index for mark in job.marks.of(MarkKind.LAYER)}
    assert len(made) == expected if every != 0.4 else expected <= len(made) < 6
    # The job's own, and the link's before it and at the end.
    assert printer.numbered.count("M400") == 3


@pytest.mark.parametrize("last", range(1, 16))
def test_host_killed_in_a_pause_after_a_layer_goes_on_exactly(tmp_path, last):
    data = layered(3, 20)
    printer, clock = MarlinPrinter(PRINTER, START), VirtualClock()
    transport = SimTransport(printer, clock)
    script = Arming(transport, last, (last % 3) / 2)
    pause_at_once = script.status

    def status(one):
        if one.state is LinkState.PRINTING and not script.armed and script.streamer:
            script.streamer.print.watch.after = MarkKind.LAYER
        pause_at_once(one)

    script.status = status  # type: ignore[method-assign]
    retreat = Retreat(relief_mm=0.3, prime_mm=0.02)
    try:
        ended = played(data, tmp_path, transport, script, retreat=retreat)
    except HostDiedError:
        history = read_journal(tmp_path / "journal.log")
        again = SimTransport(printer, clock)
        ended = played(data, tmp_path, again, Script(), retreat=retreat, history=history)
    assert ended.state is LinkState.DONE, ended
    assert_same_strokes(printer.executed(), foreseen(data))


def test_checkpoint_finds_a_position_that_is_not_the_jobs(tmp_path):
    def push(streamer: Streamer) -> None:
        printer.at["Z"] += 3.0

    data = layered(3, 20).replace(b"G0 Z10.25 F300\n", b"")
    script = Script(at_line={20: push})
    printer = Following(parse_job(data, "a"), script)
    transport = FakeTransport(printer, VirtualClock())
    status = played(data, tmp_path, transport, script, care=Care(checkpoint_s=0.0))
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "Z is 13.00" in status.message


# --- jobs of our own writer: held at their marks with the needle clear of ink
PLACE = np.array([60.0, 70.0, 20.0])
START_WRITTEN_JOBS = (60.0, 40.0, 60.0)


def fresh() -> Toolpath:
    return fresh_toolpath(as_solid(block(3, 2, 0.24)), FreshOptions())


def embedded() -> Toolpath:
    return embedded_toolpath(random_tree(8, 10, 3, 0.1), EmbeddedOptions())


@pytest.mark.parametrize(("make", "kind"), [(fresh, MarkKind.LAYER), (embedded, MarkKind.VESSEL)])
def test_pause_at_every_mark_leaves_from_above_all_that_is_written(tmp_path, make, kind):
    toolpath = make()
    syringe = load(Syringe, "hamilton_1ml")
    data = write_gcode(
        toolpath, PRINTER, syringe, PLACE, GcodeOptions(start_mm=START_WRITTEN_JOBS)
    ).data
    job = parse_job(data, "part.gcode")
    ends = job.marks.of(kind)
    reloads = job.marks.of(MarkKind.RELOAD)
    assert len(ends) > 2
    assert [mark.index for mark in reloads] == [mark.index for mark in ends[:-1]]
    paused: list[int] = []

    def on_paused(streamer: Streamer) -> None:
        paused.append(streamer.status.lines_done)
        streamer.resume(NewSyringe())

    transport = SimTransport(MarlinPrinter(PRINTER, START_WRITTEN_JOBS), VirtualClock())
    care = Care(checkpoint_s=0.0, reload_at=tuple(mark.index for mark in reloads))
    status = played(data, tmp_path, transport, Script(on_paused=on_paused), care)
    assert status.state is LinkState.DONE, status
    assert paused == list(care.reload_at)

    motion = transport.printer.executed()
    assert_same_strokes(motion, dry_run(data, PRINTER, START_WRITTEN_JOBS).executed)
    across = np.any(motion.start[:, :2] != motion.end[:, :2], axis=1)
    # Parked from above all that was written until then.
    lifts = np.flatnonzero(motion.end[:, 2] >= motion.start[:, 2] + 30)
    assert len(lifts) >= len(paused)
    for lift in lifts:
        before = slice(0, lift)
        writing = (motion.plunger_end > motion.plunger_start)[before] & across[before]
        if writing.any():
            assert motion.start[lift, 2] >= motion.end[before, 2][writing].max()


# --- syringe change during a print: planned, made, interrupted by the host's death
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
            streamer.print.queue.add(ResumeRequest())  # the printer's own button
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
    said, answers = [], []

    def on_paused(streamer: Streamer) -> None:
        said.append(streamer.status.message)
        streamer.resume(NewSyringe(0.95 if len(said) == 1 else 0.5), answer=answers.append)

    at = JOB.marks.of(MarkKind.RELOAD)[0].index
    transport = wire()
    care = Care(reload_at=(at,), capacity_mm=1.0)
    script = Script(on_paused=on_paused)
    status = played(DATA, tmp_path, transport, script, care)
    assert status.state is LinkState.DONE
    assert "the syringe has 0.05 mm left" in said[1]
    assert answers == [said[1], ""]
    assert_same_strokes(transport.printer.executed(), FORESEEN)


def test_a_named_syringe_without_a_capacity_is_not_taken_for_the_last_one() -> None:
    for name, capacity_mm in (("small", 0.0), ("", 3.0)):
        with pytest.raises(Refused, match="give its profile and a travel above 0, or neither"):
            NewSyringe(0.0, name, capacity_mm)


def test_a_refill_is_of_the_syringe_that_was_put_in_last(tmp_path):
    """Told by its used travel alone: its capacity isn't the one's that the print began with."""
    said = iter([NewSyringe(0.0, "small", 0.35)])
    script = Script(on_paused=lambda streamer: streamer.resume(next(said, NewSyringe(0.02))))
    marks = JOB.marks.of(MarkKind.RELOAD)[:2]
    care = Care(reload_at=tuple(one.index for one in marks), syringe="large", capacity_mm=50.0)
    assert played(DATA, tmp_path, wire(), script, care).state is LinkState.DONE
    put_in = [
        one for one in read_records(tmp_path / "journal.log") if one and one["t"] == "syringe"
    ]
    assert len(put_in) > 1
    assert {(one["name"], one["capacity_mm"]) for one in put_in} == {("small", 0.35)}


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
