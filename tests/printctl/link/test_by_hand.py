"""Manual commands between two lines of the job: none of them may become a part of the print."""

from __future__ import annotations

from printctl.link.clock import VirtualClock
from printctl.link.states import LinkState
from tests.printctl.link.fake_marlin import FakeTransport
from tests.printctl.link.jobs import parse_job
from tests.printctl.link.layered import Following, Script, layered, played


def followed(data, tmp_path, script):
    job = parse_job(data, "test.gcode")
    printer = Following(job, script)
    status = played(data, tmp_path, FakeTransport(printer, VirtualClock()), script)
    return status, job, printer


def by_hand(command: bytes):
    return lambda streamer: streamer.command(command, lambda lines: None)


def test_move_by_hand_between_two_lines_does_not_become_a_part_of_the_print(tmp_path):
    script = Script(
        at_line={12: lambda streamer: streamer.command(b"G0 Z15 F60", lambda lines: None)}
    )
    status, _, printer = followed(layered(2, 20), tmp_path, script)
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "Z is 15.00 mm where the job says 10.00 mm" in status.message
    assert printer.taken < 16


def test_speed_given_by_hand_between_two_lines_does_not_become_the_jobs(tmp_path):
    script = Script(at_line={12: by_hand(b"G1 F60")})
    status, _, printer = followed(layered(2, 20), tmp_path, script)
    assert status.state is LinkState.DONE
    at = printer.numbered.index("G1 F60")
    assert printer.numbered[at + 1] == "G1 F1800"
