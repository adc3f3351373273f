"""Pneumatic head: valve shut before any lift, reopened at the returned position."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles.families.marlin.sender import guard_command
from gcode.dry_run.run import dry_run
from printctl.checks.gate import LineOrigin, PrinterSituation, Refusal, judge
from printctl.checks.preflight import gcode_checks
from printctl.machine.control.board.halting import halting_of
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.dispensing import head_at, is_open, shut
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import Retreat
from printctl.machine.job.syringes import plan_head_reloads, plunger_travel
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.prints.recovery import plan_recovery
from printctl.machine.records.replay import JournalledPrint, read_journal
from printctl.machine.records.states import LinkState
from sim.devices.families.marlin_printer import MarlinPrinter
from tests.printctl.machine.link.airy import AIR, CLOSES, OPENS, START, Airy, airy, laid_by
from tests.printctl.machine.link.fake_marlin import FakeTransport
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Arming, Script, doomed, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import assert_same_strokes, strokes
from tests.printctl.machine.link.simulated_transport import HostDiedError
from tests.printctl.machine.link.two_heads import DATA as DATA_HEADS
from tests.printctl.machine.link.two_heads import FORESEEN, QUICK, job_of, machine
from tests.printctl.machine.link.two_heads import JOB as JOB_HEADS
from tests.printctl.machine.link.two_heads import START as START_HEADS
from tests.printctl.machine.link.two_valves import DATA as PAIR_DATA
from tests.printctl.machine.link.two_valves import JOB as PAIR_JOB
from tests.printctl.machine.link.two_valves import PAIR, Valves, alone
from tests.printctl.machine.link.two_valves import START as START_PAIR
from tests.slower import first_of

DATA = airy(3, 12)
JOB = parse_job(DATA, "test.gcode")
OPENING, CLOSING = OPENS.encode(), CLOSES.encode()


NAMED = AIR.model_copy(update={"extra_commands": ("G999",)})
"""Its profile names a command that the board doesn't know, so that a job may have it."""


def printed(tmp_path, script, data=DATA, **options):
    job = parse_job(data, "test.gcode", NAMED)
    printer = Airy(job=job, script=script)
    transport = FakeTransport(printer, VirtualClock())
    retreat = Retreat(prime_mm=0.5)
    status = played(data, tmp_path, transport, script, printer=NAMED, retreat=retreat, **options)
    return status, printer


def within_a_path() -> int:
    """Lines taken up to the middle of a written path."""
    return JOB.lines.index(OPENING) + 6


def sent(printer: Airy) -> list[str]:
    return [line for line in printer.executed if not line.startswith(("M105", "M114", "M110"))]


@pytest.mark.parametrize("where", ["stop", "fault", "deadman"])
def test_a_stop_within_a_path_shuts_the_valve_before_anything_else(tmp_path, where):
    script = Script()
    data, care = DATA, Care()
    if where == "stop":
        script.at_line = {within_a_path(): lambda streamer: streamer.stop()}
    elif where == "fault":
        lines = DATA.split(b"\n")
        lines.insert(lines.index(OPENING) + 5, b"G999")
        data = b"\n".join(lines)
    else:
        lines = airy(2, 300).split(b"\n")
        data = b"\n".join(line for line in lines if not line.startswith(b";"))
        care = Care(deadman_s=0.4, deadman_stops=True)
    status, printer = printed(tmp_path, script, data, care=care)
    wanted = LinkState.FAILED if where == "fault" else LinkState.STOPPED
    assert (status.state, status.position_known) == (wanted, True)
    assert not printer.is_open
    assert all(begin[2] == end[2] for begin, end in printer.laid)  # never lifted while it was open
    commands = sent(printer)
    last = max(k for k, line in enumerate(commands) if line in data.decode().split("\n")[6:-1]
               and line.startswith(("G1", OPENS, "G999", "G4")) and " Z" not in line)  # fmt: skip
    assert commands[last + 1] == CLOSES
    assert not any(" E" in line and "M118" not in line for line in commands)


@pytest.mark.parametrize("seed", first_of(range(20), 6))
def test_paused_at_random_moments_the_same_is_laid_as_without(tmp_path, seed):
    rng = np.random.default_rng(seed)
    requests = [
        lambda streamer: streamer.pause(),
        lambda streamer: streamer.pause(),
        lambda streamer: streamer.pause(MarkKind.LAYER),
        lambda streamer: streamer.reload(),
    ]

    def go_on(streamer: Streamer) -> None:
        changing = streamer.status.waits_for == "syringe"
        streamer.resume(NewSyringe() if changing else None)

    moments = sorted(rng.choice(np.arange(7, len(JOB) - 40), size=4, replace=False).tolist())
    script = Script(on_paused=go_on)
    script.at_line = {line: requests[rng.integers(4)] for line in moments}
    status, printer = printed(tmp_path, script, care=Care(checkpoint_s=0.0))
    assert status.state is LinkState.DONE, status
    assert status.alarms == 0
    assert len(script.pauses) >= 1
    alone = laid_by(JOB)
    assert printer.laid == alone.laid
    assert not printer.is_open
    assert {place[2] for place in printer.opened} <= {place[2] for place in alone.opened}
    own = [line for line in printer.executed if not line.startswith("M118")]
    assert not any(" E" in line or line.startswith("M82") for line in own)


def test_resumed_within_a_path_the_valve_opens_last_and_its_delay_is_waited_for(tmp_path):
    script = Script(at_line={within_a_path(): lambda streamer: streamer.pause()})
    status, printer = printed(tmp_path, script)
    assert status.state is LinkState.DONE
    commands = sent(printer)
    opened = [k for k, line in enumerate(commands) if line == OPENS]
    ours = opened[1]  # the job's own is the first
    assert commands[ours + 1] == "G4 P30"
    assert commands[ours + 2] == JOB.lines[script.pauses[0].lines_done].decode()
    down = next(k for k in range(ours, 0, -1) if commands[k].startswith("G1 Z"))
    assert commands[down] == "G1 Z10.00000 F300"
    assert "M400" in commands[down:ours]
    lift = next(k for k in range(down - 1, 0, -1) if commands[k].startswith("G1 Z30"))
    assert CLOSES in commands[lift - 2 : lift]


def test_a_position_that_is_wrong_ends_the_print_with_the_valve_shut(tmp_path):
    moved = []

    def push(streamer: Streamer) -> None:
        printer.at["Z"] += 1.0
        moved.append(True)
        streamer.print.progress.unverified = True  # as after a stray ok

    script = Script(at_line={within_a_path(): push})
    printer = Airy(job=JOB, script=script)
    transport = FakeTransport(printer, VirtualClock())
    status = played(DATA, tmp_path, transport, script, printer=AIR)
    assert moved
    assert status.state is LinkState.POSITION_UNKNOWN
    assert not printer.is_open
    assert printer.numbered[-2:] == [CLOSES, "G4 P30"]


def test_where_the_protocol_is_over_the_valve_is_shut_past_it(tmp_path):
    """The board was reset: no numbered line would be taken any more."""

    def meddle(streamer: Streamer) -> None:
        transport.waiting += printer.reset()

    script = Script(at_line={within_a_path(): meddle})
    printer = Airy(job=JOB, script=script)
    transport = FakeTransport(printer, VirtualClock())
    status = played(DATA, tmp_path, transport, script, printer=AIR)
    assert status.state is LinkState.POSITION_UNKNOWN
    assert not printer.is_open


def test_nothing_is_sent_to_a_printer_that_another_profile_is_of(tmp_path):
    script = Script()
    printer = Airy(job=JOB, script=script)
    printer.firmware = "Teacup"
    transport = FakeTransport(printer, VirtualClock())
    status = played(DATA, tmp_path, transport, script, printer=AIR)
    assert status.state is LinkState.FAILED
    assert CLOSES not in printer.executed


@pytest.mark.parametrize("seed", first_of(range(12), 4))
def test_a_host_that_died_shuts_the_valve_first_and_rejoins(tmp_path, seed):
    rng = np.random.default_rng(seed)
    clock, printer = VirtualClock(), MarlinPrinter(AIR, START)
    transport = SimTransport(printer, clock)
    transport.die_at(int(rng.integers(46, 96)), float(rng.random()))
    with pytest.raises(HostDiedError):
        played(DATA, tmp_path, transport, Script(), printer=AIR)
    transport = SimTransport(printer, clock)
    said: list[bytes] = []
    write = transport.write

    def writing(data: bytes) -> None:
        said.extend(line for line in data.split(b"\n") if line.startswith(b"N"))
        write(data)

    transport.write = writing  # type: ignore[method-assign]
    history, script = read_journal(tmp_path / "journal.log"), Script()
    status = played(DATA, tmp_path, transport, script, history=history, printer=AIR)
    assert status.state is LinkState.DONE, status
    asked = (b"M105", b"M110")
    commands = [line for line in said if not any(word in line for word in asked)]
    assert CLOSING in commands[0]
    done = next(one.lines_done for one in script.seen if one.state is LinkState.PRINTING)
    stood_open = is_open(JOB.lines, done, AIR)
    assert (status.alarms == 1) == stood_open
    plain = [line.split(b" ", 1)[1].split(b"*")[0] for line in commands]
    rest = [guard_command(line) for line in JOB.lines[done : done + 2]]
    back = next(k for k in range(len(plain)) if plain[k : k + 2] == rest)
    opened = [k for k, line in enumerate(commands[:back]) if OPENING in line]
    down = next(k for k, line in enumerate(commands) if b"G1 Z" in line)
    assert len(opened) == stood_open
    assert all(down < k for k in opened)


@pytest.mark.parametrize("begin", range(7, len(JOB) - 2, 5))
def test_rest_of_a_job_opens_the_valve_only_where_the_tip_is_back(begin):
    plan = plan_recovery(
        JOB, DATA, JournalledPrint(done=len(JOB)), AIR, Retreat(prime_mm=1.0), JOB.file_lines[begin]
    )
    rest = parse_job(plan.gcode, "rest")
    before = len(rest) - (len(JOB) - begin)
    way = [line.decode() for line in rest.lines[:before]]
    assert way[0] == CLOSES
    assert not any(" E" in line or line.startswith("M82") for line in way)
    stood_open = is_open(JOB.lines, begin, AIR)
    assert way.count(OPENS) == stood_open
    if stood_open:
        assert way[-3:] == ["M400", OPENS, "G4 P30"]
    alone, ours = laid_by(JOB), laid_by(rest)
    assert ours.laid == alone.laid[len(alone.laid) - len(ours.laid) :]
    assert "plunger" not in " ".join(plan.steps)
    assert "pressure off" in plan.steps[0]


# --- several valves: shut and at rest at every end, the pressure set again before one opens
WRITTEN = alone(PAIR_JOB).laid


def of_pair(tmp_path, script, care=None):
    printer = Valves(script=script)
    transport = FakeTransport(printer, VirtualClock())
    status = played(PAIR_DATA, tmp_path, transport, script, care=care, printer=PAIR)
    return status, printer


def test_job_alone_opens_each_valve_at_its_pressure_and_ends_at_rest():
    printer = alone(PAIR_JOB)
    assert printer.is_safe
    assert not printer.wrong
    assert {head for head, _, _ in printer.laid} == {0, 1}
    assert not any(line.startswith((b"T", b"M218")) for line in PAIR_JOB.lines)


@pytest.mark.parametrize("line", range(3, len(PAIR_JOB) - 1, 9))
def test_a_stop_at_any_line_leaves_every_valve_shut_and_all_air_at_rest(tmp_path, line):
    script = Script(at_line={line: lambda streamer: streamer.stop()})
    status, printer = of_pair(tmp_path, script)
    assert status.state is LinkState.STOPPED
    assert printer.is_safe
    assert not printer.wrong
    assert printer.laid == WRITTEN[: len(printer.laid)]


@pytest.mark.parametrize("seed", first_of(range(20), 6))
def test_heads_with_valves_paused_and_reloaded_lay_the_same(tmp_path, seed):
    rng = np.random.default_rng(seed)
    safe = []

    def go_on(streamer: Streamer) -> None:
        safe.append(printer.is_safe)
        changing = streamer.status.waits_for.startswith("syringe")
        streamer.resume(NewSyringe() if changing else None)

    requests = [lambda streamer: streamer.pause(), lambda streamer: streamer.reload(1)]
    moments = rng.choice(np.arange(7, len(PAIR_JOB) - 30), size=4, replace=False).tolist()
    script = Script(on_paused=go_on)
    script.at_line = {line: requests[k % 2] for k, line in enumerate(sorted(moments))}
    printer = Valves(script=script)
    transport = FakeTransport(printer, VirtualClock())
    status = played(PAIR_DATA, tmp_path, transport, script, printer=PAIR)
    assert (status.state, status.alarms) == (LinkState.DONE, 0), status
    assert safe
    assert all(safe)
    assert printer.is_safe
    assert not printer.wrong
    assert printer.laid == WRITTEN


@pytest.mark.parametrize("seed", first_of(range(16), 5))
def test_a_dead_host_s_successor_shuts_both_valves_and_sets_the_pressure_before_one_opens(
    tmp_path, seed
):
    rng = np.random.default_rng(seed)
    clock, printer = VirtualClock(), MarlinPrinter(PAIR, START_PAIR)
    transport = SimTransport(printer, clock)
    transport.die_at(int(rng.integers(60, 130)), float(rng.random()))
    with pytest.raises(HostDiedError):
        played(PAIR_DATA, tmp_path, transport, Script(), printer=PAIR)
    transport, seen = SimTransport(printer, clock), Valves()
    write = transport.write

    def writing(data: bytes) -> None:
        for line in data.split(b"\n"):
            if line.startswith(b"N"):
                seen._do(line.split(b" ", 1)[1].split(b"*")[0].decode().replace("M0", "M"))
        write(data)

    transport.write = writing  # type: ignore[method-assign]
    history = read_journal(tmp_path / "journal.log")
    status = played(PAIR_DATA, tmp_path, transport, Script(), history=history, printer=PAIR)
    assert status.state is LinkState.DONE, status
    assert seen.is_safe
    switched = [line for line in seen.executed if line.startswith("M106 P")]
    assert switched[:4] == [line.decode() for line in shut(PAIR)]
    assert not seen.wrong


@pytest.mark.parametrize("begin", range(16, len(PAIR_JOB) - 2, 6))
def test_rest_of_a_job_of_two_valves_lays_the_rest_with_the_same_heads(begin):
    history, line = JournalledPrint(done=len(PAIR_JOB)), PAIR_JOB.file_lines[begin]
    plan = plan_recovery(PAIR_JOB, PAIR_DATA, history, PAIR, Retreat(), line)
    rest = Valves(output={0: 255, 1: 0, 2: 99, 3: 99, 4: 0, 5: 0})
    for command in parse_job(plan.gcode, "rest", PAIR).lines:
        rest._do(command.decode())
    assert rest.is_safe
    assert not rest.wrong
    assert rest.laid == WRITTEN[len(WRITTEN) - len(rest.laid) :]
    run = dry_run(plan.gcode, PAIR, START_PAIR)
    assert not [one for one in gcode_checks(run, PAIR) if one.refuses]


def test_a_halt_tells_the_valves_to_shut_before_the_firmware_dies():
    for parser in (True, False):
        halting = halting_of(PAIR, b"M112\n", emergency_parser=parser)
        told = b"".join(data for data, _ in halting.first)
        assert all(b"\n%b\n" % command in told for command in (b"M106 P0 S0", b"M106 P1 S0"))
        assert sum(wait for _, wait in halting.first) == (2.8 if parser else 0.0)


@pytest.mark.parametrize("text", ["M106 P2 S200", "M106 P1 S255", "M106 P3 S5"])
def test_pressure_and_valves_are_not_for_the_console(text):
    assert isinstance(judge(text, LineOrigin.CONSOLE, PrinterSituation.of_job(PAIR)), Refusal)


# --- two-head prints: pause, stop, syringe change, and resumption after the host's death
RETREAT = Retreat(relief_mm=0.005, others=(Retreat(relief_mm=0.002),))


def went_on(folder, printer, clock, script=None, **more):
    """Resume in the folder until the print is done; anew where no line of the job had left."""
    transport = SimTransport(printer, clock)
    history = read_journal(folder / "journal.log")
    if not history.begun:  # `resumable` refuses it
        (folder / "journal.log").unlink()
        history = None
    return played(
        DATA_HEADS, folder, transport, script or Script(), history=history, printer=QUICK,
        retreat=RETREAT, **more,
    )  # fmt: skip


# In 35 the first renumbering is lost to half a line; once it was repeated for ever.
@pytest.mark.parametrize("seed", first_of([35, *range(35), *range(36, 60)], 6))
def test_a_host_killed_at_any_moment_goes_on_with_the_same_head(tmp_path, seed):
    rng = np.random.default_rng(seed)
    printer, clock = machine()
    last, part = (
        int(rng.integers(1, 2 * len(JOB_HEADS))),
        float(rng.choice([0.0, rng.uniform(), 1.0])),
    )
    transport = doomed(printer, clock, last, part)
    try:
        status = played(DATA_HEADS, tmp_path, transport, Script(), printer=QUICK, retreat=RETREAT)
    except HostDiedError:
        if seed % 3 == 0:  # somebody took the other head meanwhile
            printer.exchange(b"T0 S1\n" if printer.machine.motion.tool else b"T1 S1\n")
            printer.take_output()
        status = went_on(tmp_path, printer, clock)
    assert status.state is LinkState.DONE, status
    assert_same_strokes(printer.executed(), FORESEEN, 1.01 / 6400)


def test_a_stop_leaves_with_the_head_in_use_relieved(tmp_path):
    printer, clock = machine()
    first = JOB_HEADS.lines.index(b"T1 S1")
    when = next(
        k
        for k in range(first, len(JOB_HEADS))
        if b" E" in JOB_HEADS.lines[k] and b"X" in JOB_HEADS.lines[k]
    )

    class Watched(SimTransport):
        def write(self, data):
            super().write(data)
            if script.streamer.status.lines_done >= when + 2:
                script.streamer.stop()

    script = Script()
    transport = Watched(printer, clock)
    status = played(DATA_HEADS, tmp_path, transport, script, printer=QUICK, retreat=RETREAT)
    assert status.state is LinkState.STOPPED
    done = printer.executed()
    pulled = done.plunger_end - done.plunger_start
    assert done.tool[pulled < 0][-1] == 1
    assert pulled[pulled < 0][-1] == pytest.approx(-0.002, abs=2e-4)
    assert done.end[-1, 2] > done.end[-3, 2]


def test_a_firmware_built_for_one_extruder_is_refused_before_the_first_line(tmp_path):
    one = MarlinPrinter(QUICK.model_copy(update={"heads": ()}), START_HEADS)
    transport = SimTransport(one, VirtualClock())
    status = played(DATA_HEADS, tmp_path, transport, Script(), printer=QUICK)
    assert (status.state, status.error) == (LinkState.FAILED, "HandshakeError")
    assert "built for 1 (EXTRUDER_COUNT)" in status.message
    assert len(one.executed()) == 0


def change(streamer):
    """Drive the plunger of the head whose syringe is changed, then say it is done."""
    if not streamer.status.waits_for.startswith("syringe "):
        streamer.resume()
        return
    streamer.command(b"G1 E-2 F60", lambda said: None)
    streamer.command(b"M400", lambda said: streamer.resume(NewSyringe()))


def test_the_syringe_of_the_idle_head_is_changed_without_a_stroke_of_the_other(tmp_path):
    reloads = [mark.index for mark in JOB_HEADS.marks.of(MarkKind.RELOAD)]
    plan = {
        index: head
        for index in reloads
        for head in (0, 1)
        if head_at(JOB_HEADS.lines, index, QUICK) == 1 - head
    }
    care = Care(reload_at=tuple(plan), reload_heads=tuple(plan.values()))
    assert {0, 1} == set(plan.values())
    printer, clock = machine()
    script = Script(on_paused=change)
    transport = SimTransport(printer, clock)
    status = played(
        DATA_HEADS, tmp_path, transport, script, care=care, printer=QUICK, retreat=RETREAT
    )
    assert status.state is LinkState.DONE, status
    assert len([one for one in script.pauses if "head " in one.message]) == len(plan)
    assert_same_strokes(printer.executed(), FORESEEN, 1.01 / 6400)


@pytest.mark.parametrize("seed", first_of(range(30), 8))
def test_a_host_killed_while_a_syringe_is_changed(tmp_path, seed):
    rng = np.random.default_rng(200 + seed)
    reloads = [mark.index for mark in JOB_HEADS.marks.of(MarkKind.RELOAD)]
    index, head = int(rng.choice(reloads)), int(rng.integers(2))
    care = Care(reload_at=(index,), reload_heads=(head,))
    printer, clock = machine()
    transport = SimTransport(printer, clock)
    script = Arming(transport, int(rng.integers(1, 24)), float(rng.uniform()), on_paused=change)
    try:
        status = played(
            DATA_HEADS, tmp_path, transport, script, care=care, printer=QUICK, retreat=RETREAT
        )
    except HostDiedError:
        again = Script(on_paused=change)
        status = went_on(tmp_path, printer, clock, again, care=care)
    assert status.state is LinkState.DONE, status
    assert_same_strokes(printer.executed(), FORESEEN, 1.01 / 6400)


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
    at = next(k for k, line in enumerate(JOB_HEADS.lines) if line == b"T1 S1") + 6
    transport = doomed(printer, clock, 2 * at + 20, 1.0)
    with pytest.raises(HostDiedError):
        played(DATA_HEADS, tmp_path, transport, Script(), printer=QUICK, retreat=RETREAT)
    printer.firmware.take_tool = lambda command: None  # as a build with one extruder: silence
    before = printer.machine.motion.planner["position"][0].tolist()
    status = went_on(tmp_path, printer, clock)
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "doesn't confirm head" in status.message
    assert printer.machine.motion.planner["position"][0].tolist() == before


@pytest.mark.parametrize("part", [0.3, 0.5, 0.8])
def test_the_rest_of_a_job_is_printed_by_the_same_heads(tmp_path, part):
    first = int(part * len(JOB_HEADS))
    mark = JOB_HEADS.marks.next(MarkKind.VESSEL, first)
    begin = mark.index
    history = read_journal_of(tmp_path)
    found = plan_recovery(
        JOB_HEADS, DATA_HEADS, history, QUICK, RETREAT, from_line=JOB_HEADS.file_lines[begin]
    )
    run = dry_run(found.gcode, QUICK, START_HEADS)
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
    played(DATA_HEADS, folder, SimTransport(printer, clock), Script(), printer=QUICK)
    return read_journal(folder / "journal.log")
