"""Pneumatic head: valve shut before any lift, reopened at the returned position."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles.families.marlin.bit_flips import guard_command
from printctl.machine.link.care import Care, NewSyringe
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.journalled_print import JournalledPrint, read_journal
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.recovering import plan_recovery
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState
from printctl.machine.link.streamer import Streamer
from printctl.machine.link.valve import is_open
from sim.devices.families.marlin.printer import MarlinPrinter
from tests.printctl.machine.link.airy import AIR, CLOSES, OPENS, START, Airy, airy, laid_by
from tests.printctl.machine.link.fake_marlin import FakeTransport
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Script, played
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
