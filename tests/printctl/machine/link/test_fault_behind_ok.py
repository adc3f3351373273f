"""Error, halt or reset right behind an ok in the same read: no further line is sent."""

from __future__ import annotations

import re
from functools import partial

import pytest

from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import Fault, FirmwareHalted, FirmwareReset
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.pairing import Pairing
from firmware_profiles.families.reprapfirmware.facts import RrfProtocol
from printctl.machine.link.modal import places

JOB = [b"G1 X%d" % k for k in range(1, 101)]
RRF = partial(RrfProtocol, places)
FAULTS = [
    (KlipperProtocol, b"ok\n!! Move out of range: 501.000 0.000 0.000 [0.000]\n"),
    (KlipperProtocol, b'ok\n// Unknown command:"G1"\nok\n'),
    (RRF, b"ok\nError: G1: outside machine limits\n"),
    (RRF, b"ok\nWarning: motor was not driven because it failed\nok\n"),
    (MarlinProtocol, b"ok\nError:Heating failed\n"),
    (MarlinProtocol, b"ok\r\nX:1.00\r\necho: cold extrusion prevented\r\n"),
]
GLUED = [
    (KlipperProtocol, b"ok!! Driver wobble\n"),
    (KlipperProtocol, b"ok !! Driver wobble\n"),
    (KlipperProtocol, b'ok// Unknown command:"G1"\n'),
    (RRF, b"okError: G1: outside machine limits\n"),
]
ENDS = [
    (KlipperProtocol, b"ok\n// Klipper state: Shutdown\n", FirmwareHalted),
    (KlipperProtocol, b"ok\n// Klipper state: Ready\n", FirmwareReset),
    (RRF, b"ok\nEmergency Stop! Reset the controller to continue.\n", FirmwareHalted),
    (MarlinProtocol, b"ok\nError:Printer halted. kill() called!\n", FirmwareHalted),
    (MarlinProtocol, b"ok\n//action:poweroff\n", FirmwareHalted),
    (MarlinProtocol, b"ok\nstart\n", FirmwareReset),
]


def in_flight(family):
    protocol = family()
    protocol.load(JOB, 0, 0)
    protocol.held = False
    protocol.go(0.0)
    assert b"G1 X1" in protocol.take_output()
    return protocol


def assert_nothing_leaves(protocol):
    assert b"G1" not in protocol.take_output()
    for second in range(1, 100):
        protocol.feed(b"ok\n", second)
        protocol.tick(float(second))
        assert b"G1" not in protocol.take_output()


@pytest.mark.parametrize(("family", "said"), FAULTS)
def test_no_further_line_leaves_where_an_error_is_behind_the_ok(family, said):
    protocol = in_flight(family)
    events = protocol.feed(said, 0.1)
    assert [event.line for event in events if isinstance(event, Fault)] == [1]
    assert (protocol.idle, protocol.lines_done) == (True, 1)
    assert_nothing_leaves(protocol)
    assert protocol.lines_done == 1


@pytest.mark.parametrize(("family", "said"), GLUED)
def test_an_ok_glued_to_an_error_is_both_answer_and_error(family, said):
    protocol = in_flight(family)
    (fault,) = protocol.feed(said, 0.1)
    assert (fault.line, fault.refused) == (1, True)
    assert (protocol.idle, protocol.lines_done) == (True, 1)
    assert_nothing_leaves(protocol)


def test_a_line_answered_by_an_error_whose_ok_is_lost_isnt_sent_again():
    protocol = KlipperProtocol(places)
    protocol.load(JOB, 1, 1)
    protocol.held = False
    protocol.go(0.0)
    assert protocol.take_output() == b"G1 X2\n"
    protocol.feed(b"!! Driver wobbleok\n", 0.1)
    protocol.tick(protocol.deadline)
    assert protocol.take_output() == b"M114\n"
    protocol.feed(b"X:1.000 Y:0.000 Z:0.000 E:0.000\nok\n", 2.0)
    protocol.tick(protocol.deadline)
    assert (protocol.take_output(), protocol.idle) == (b"", True)


@pytest.mark.parametrize(("family", "said", "end"), ENDS)
def test_no_further_line_leaves_where_a_halt_or_reset_is_behind_the_ok(family, said, end):
    protocol = in_flight(family)
    events = [*protocol.feed(said, 0.1), *protocol.tick(9.0)]
    assert isinstance(events[-1], end)
    assert protocol.lines_done == 1
    assert_nothing_leaves(protocol)


@pytest.mark.parametrize("said", [b"ok\nError:Heating failed\n", b"ok\nError:Printer halted\n"])
def test_of_two_in_flight_no_third_leaves_behind_an_error(said):
    protocol = in_flight(lambda: MarlinProtocol(pairing=Pairing(128)))
    protocol.feed(said, 0.1)
    assert b"G1 X3" not in protocol.take_output()


@pytest.mark.parametrize("family", [KlipperProtocol, RRF, MarlinProtocol])
def test_a_command_that_waits_leaves_once_the_error_is_heard_and_the_job_once_it_may(family):
    protocol = in_flight(family)
    protocol.submit(b"M114", 0.05)
    protocol.feed(b"ok\necho: cold extrusion prevented\nError: it is cold\n!! cold\n", 0.1)
    assert re.search(rb"M0?114", protocol.take_output())
    protocol.feed(b"X:1.00 Y:0.00 Z:0.00 E:0.00\nok\n", 0.2)
    protocol.held = False
    protocol.go(0.3)
    assert b"G1 X2" in protocol.take_output()


@pytest.mark.parametrize("family", [KlipperProtocol, RRF, MarlinProtocol])
def test_a_text_behind_the_ok_holds_nothing(family):
    protocol = in_flight(family)
    protocol.feed(b"ok\nT:21.0 /0.0\n", 0.1)
    assert b"G1 X2" in protocol.take_output()
