"""Pneumatic head: valve shut before any lift, reopened at the returned position."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles.families.marlin.sender import guard_command
from printctl.machine.link.care import Care, NewSyringe
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.firmware import mode_lines
from printctl.machine.link.journalled_print import JournalledPrint, read_journal
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.modal import Modal
from printctl.machine.link.recovering import plan_recovery
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState
from printctl.machine.link.streamer import Streamer
from printctl.machine.link.valve import is_about_valve, is_open, reopen, shut, shut_and_wait
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.reading import read_line
from tests.printctl.machine.link.airy import AIR, CLOSES, HEAD, OPENS, START, Airy, airy, laid_by
from tests.printctl.machine.link.fake_marlin import FakeTransport
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import PRINTER, Arming, Script, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated_transport import HostDiedError
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


# --- what is read and said -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "about"),
    [
        (b"M106 P0 S255", True),
        (b"M106 S0 P0", True),
        (b"M106P0S128", True),
        (b"M0106 P0 S255.0", True),
        (b"M106 P1 S255", False),
        (b"M1060 P0 S255", False),
        (b"G1 X1", False),
        (b"M104 S0", False),
    ],
)
def test_lines_about_the_valve_are_told_from_others(line, about):
    assert is_about_valve(read_line(line, AIR).text, AIR) == about
    assert not is_about_valve(line, PRINTER)


@pytest.mark.parametrize(
    ("line", "opened"),
    [
        (b"SET_PIN PIN=air VALUE=1", True),
        (b"set_pin VALUE=1 PIN=air", True),
        (b"SET_PIN PIN=air VALUE=0", False),
        (b"SET_PIN PIN=air VALUE=0.5", False),
        (b"SET_PIN PIN=lamp VALUE=1", True),
    ],
)
def test_klipper_s_pins_are_told_by_name(line, opened):
    words = {"opens": "SET_PIN PIN=air VALUE=1", "closes": "SET_PIN PIN=air VALUE=0"}
    head = HEAD.model_copy(update=words)
    klipper = AIR.model_copy(update={"firmware": "klipper", "dispenser": head})
    assert is_open([b"SET_PIN PIN=air VALUE=1", line], 2, klipper) == opened


def test_the_last_line_about_the_valve_counts():
    lines = [CLOSING, b"G0 X1", b"M106 S255 P0", b"G4 P30", b"M106 P1 S0", b"G1 X2", CLOSING]
    assert [is_open(lines, done, AIR) for done in range(8)] == [False] * 3 + [True] * 4 + [False]
    assert reopen(lines, 5, AIR) == [OPENING, b"G4 P30"]
    assert reopen(lines, 7, AIR) == []
    assert reopen(lines, 5, PRINTER) == []


def test_needle_leaves_with_the_valve_shut_and_without_e():
    at = Modal(x=1, y=2, z=3, e=4.0, f=600)
    assert Retreat(lift_mm=20).leave(at, AIR) == [CLOSING, b"G1 Z23.00000 F300"]
    assert Retreat().rejoin(at, AIR, prime_mm=0.5) == [b"G1 Z3.00000 F300", b"G1 F600"]
    assert Retreat().leave(Modal(), AIR) == [CLOSING]
    assert shut(PRINTER) == []
    assert shut_and_wait(AIR) == [CLOSING, b"G4 P30"]


def test_modes_of_a_head_without_plunger_have_no_e():
    assert mode_lines(AIR) == (b"G21", b"G90")
    assert mode_lines(PRINTER) == (b"G21", b"G90", b"M82")


# --- stops and pauses --------------------------------------------------------------------------


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


@pytest.mark.parametrize("seed", first_of(range(10), 3))
def test_pauses_on_a_noisy_line_lay_the_same_as_well(tmp_path, seed):
    rng = np.random.default_rng(seed)
    moments = rng.choice(np.arange(7, len(JOB) - 40), size=4, replace=False).tolist()
    script = Script(at_line={line: lambda streamer: streamer.pause() for line in moments})
    printer = Airy(job=JOB, script=script)
    transport = FakeTransport(printer, VirtualClock(), rng, noise=0.001, drop_ok=0.01)
    status = played(DATA, tmp_path, transport, script, Care(checkpoint_s=0.0), printer=AIR)
    assert status.state is LinkState.DONE, status
    assert printer.laid == laid_by(JOB).laid
    assert not printer.is_open


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


def test_paused_between_paths_the_valve_stays_shut(tmp_path):
    travel = JOB.lines.index(CLOSING, 10) + 3
    script = Script(at_line={travel: lambda streamer: streamer.pause()})
    status, printer = printed(tmp_path, script)
    assert status.state is LinkState.DONE
    assert printer.executed.count(OPENS) == JOB.lines.count(OPENING)


def test_a_position_that_is_wrong_ends_the_print_with_the_valve_shut(tmp_path):
    moved = []

    def push(streamer: Streamer) -> None:
        printer.at["Z"] += 1.0
        moved.append(True)
        streamer.parts.channel.logbook.progress.doubt()  # as after a stray ok

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


# --- a host that died ----------------------------------------------------------------------------


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


def test_a_host_that_died_in_a_change_of_syringe_told_or_not(tmp_path):
    told = set()
    for last in range(1, 24):
        folder = tmp_path / str(last)
        folder.mkdir()
        clock, printer = VirtualClock(), MarlinPrinter(AIR, START)
        transport = SimTransport(printer, clock)

        def change(streamer: Streamer) -> None:
            streamer.resume(NewSyringe() if streamer.status.waits_for == "syringe" else None)

        script = Arming(transport, last, 1.0, on_paused=change)
        script.at_line = {}
        try:
            reload_at = (JOB.marks.of(MarkKind.RELOAD)[0].index,)
            played(DATA, folder, transport, script, Care(reload_at=reload_at), printer=AIR)
        except HostDiedError:
            history = read_journal(folder / "journal.log")
            printer.settle()
            counted = history.syringe and history.syringe["n"] <= printer.lines.last_number
            again = Script(on_paused=change)
            status = played(
                DATA, folder, SimTransport(printer, clock), again, history=history, printer=AIR
            )
            assert status.state is LinkState.DONE, (last, status)
            asked = any(one.waits_for == "syringe" for one in again.pauses)
            told.add((history.reload is not None, bool(counted), asked))
    changing, counted_too = (True, False, True), (True, True, False)
    assert {changing, counted_too} <= told <= {changing, counted_too, (False, False, True),
                                               (False, False, False)}  # fmt: skip


# --- the rest of a job ---------------------------------------------------------------------------


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
