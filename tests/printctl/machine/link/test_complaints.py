"""Complaints of a printer in every state of its link, in any order with other text."""

from __future__ import annotations

import re
from functools import partial

import pytest

from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.known_messages import MessageMeaning, load_messages
from firmware_profiles.families.link_protocol import (
    Fault,
    FirmwareHalted,
    FirmwareReset,
    Halting,
    Remark,
)
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.state import QUESTION
from firmware_profiles.families.pairing import Pairing
from firmware_profiles.families.reprapfirmware.facts import RrfProtocol
from printctl.machine.job.coordinates import places
from printctl.machine.records.states import LinkState
from tests.printctl.machine.link.fake_families import FakeDuet
from tests.printctl.machine.link.test_families import JOB as FAMILY_JOB
from tests.printctl.machine.link.test_families import streamer_of as family_streamer

JOB = [b"G1 X%d" % k for k in range(1, 101)]
ANSWER = b"Error:Line Number is not Last Line Number+1, Last Line: %d\nResend: %d\nok\n"
STOPPED = b"Printer stopped due to errors. Fix the error and use M999 to restart."
SAID = [b"Error:MINTEMP triggered, system stopped! Heater_ID: 0", STOPPED, b"Error:any other"]
FAMILIES = {"marlin": MarlinProtocol, "pairs": partial(MarlinProtocol, pairing=Pairing(128))}


def in_flight(family=MarlinProtocol):
    """A protocol that has sent the first of the job's lines, and how many of them."""
    protocol = family()
    protocol.load(JOB, 0, 0)
    protocol.held = False
    protocol.go(0.0)
    sent = protocol.take_output()
    assert b"G1 X1" in sent
    return protocol, sent.count(b"G1")


def streaming(family=MarlinProtocol):
    return in_flight(family)[0]


def assert_nothing_leaves(protocol, now=0.0):
    assert b"G1" not in protocol.take_output()
    for second in range(1, 100):
        protocol.feed(b"ok\n", now + second)
        protocol.tick(now + second + 0.5)
        assert b"G1" not in protocol.take_output()


def doubting(protocol, now=0.1):
    """An unknown text: the link waits until nothing more comes."""
    return list(protocol.feed(b"some text\n", now)), now


def asking(protocol):
    events, now = doubting(protocol)
    events += protocol.tick(now + 0.051)
    assert QUESTION in protocol.take_output()
    return events, now + 0.06


def settling(protocol):
    events, now = asking(protocol)
    events += protocol.feed(ANSWER % (0, 1), now)
    return events, now + 0.01


def waiting_for_a_token(protocol):
    events, now = asking(protocol)
    events += protocol.feed(ANSWER % (1, 2), now)
    events += protocol.tick(now + 0.051)
    assert not protocol.idle
    return events, now + 0.06


def resting(protocol):
    protocol.held = True
    events = [*protocol.feed(b"ok\n", 0.1), *protocol.feed(b"ok\n", 0.11)]
    assert protocol.idle
    return events, 0.12


def answering(protocol):
    protocol.submit(b"M105", 0.0)
    return list(protocol.feed(b"ok\n" * 2, 0.1)), 0.11


STATES = [doubting, asking, settling, waiting_for_a_token, resting, answering]


@pytest.mark.parametrize("said", SAID)
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("family", FAMILIES)
def test_an_error_counts_in_every_state_and_no_line_of_the_job_follows(family, state, said):
    protocol = streaming(FAMILIES[family])
    before, now = state(protocol)
    assert not any(isinstance(event, Fault) for event in before)
    events = [*protocol.feed(said + b"\r\n", now)]
    assert [event.text for event in events if isinstance(event, Fault)] == [said.decode()]
    protocol.take_output()
    assert_nothing_leaves(protocol, now)


@pytest.mark.parametrize("state", STATES)
def test_an_unknown_command_counts_in_every_state(state):
    protocol = streaming()
    _, now = state(protocol)
    events = protocol.feed(b'echo:Unknown command: "G1 X1"\n', now)
    faults = [event for event in events if isinstance(event, Fault)]
    assert [(fault.line, fault.refused) for fault in faults] == [(1, True)]


@pytest.mark.parametrize(
    "said",
    [
        b"ok T:21.0 /0.0Error:any other\n",
        b"okError:any other\n",
        b"echo:busy: processing" + STOPPED + b"\n",
        b" T:21.3 /0.0 B:20.9 /0.0" + STOPPED + b"\nok\n",
        b"X:1.00 Y:2.00 MINTEMP ERROR\nok\n",
        b"noise\n" + STOPPED + b"\nok\n",
        STOPPED + b"\nnoise\nok\n",
        b"noise\necho: cold extrusion prevented\nok\n",
        b'noise\necho:Unknown command: "G1 X1"\nok\n',
        b'echo:Unknown command: "G1 X1"\nnoise\nok\n',
        b"Unknown G code: N1 G1 X1*73\nok\n",
        b'ok\nUnknown command: "G1 X1"\n',
    ],
)
@pytest.mark.parametrize("cut", [0, 1, 7])
def test_a_complaint_counts_once_glued_to_other_text_and_split_over_reads(said, cut):
    protocol = streaming()
    events = [*protocol.feed(said[:cut], 0.1), *protocol.feed(said[cut:], 0.11)]
    faults = [event for event in events if isinstance(event, Fault)]
    assert [(fault.line, fault.refused) for fault in faults] == [(1, True)]
    assert b"G1 X2" not in protocol.take_output()


def test_ordinary_chatter_begins_no_doubt_and_unknown_text_is_reported():
    protocol = streaming()
    chatter = b"NORMAL MODE: Percent done: 9; print time remaining in mins: 15\n"
    assert not protocol.feed(chatter, 0.1)
    assert not protocol.feed(b"ok\n", 0.11)
    assert b"G1 X2" in protocol.take_output()
    assert protocol.feed(b"Wobble exceeded\n", 0.2) == [Remark("Wobble exceeded")]


@pytest.mark.parametrize(
    ("families", "text", "meaning"),
    [
        (("prusa", "marlin"), "Error:Printer halted. kill() called!", "halt"),
        (("prusa", "marlin"), "Error:0: Heaters switched off. MINTEMP triggered!", "fault"),
        (("prusa", "marlin"), "Hotend fan speed is lower than expected", "fault"),
        (("prusa", "marlin"), "Error:!! KILL caused by KILL button/pin", "fault"),
        (("prusa", "marlin"), "!!", "fault"),
        (("prusa", "marlin"), "echo:M112 Shutdown", "halt"),
        (("prusa", "marlin"), "echo:Home XYZ First", "refusal"),
        (("prusa", "marlin"), "Error:No Line Number with checksum, Last Line: 5", "line_error"),
        (("prusa", "marlin"), 'echo:enqueueing "M600"', "notice"),
        (("reprapfirmware",), "Emergency Stop! Reset the controller to continue.", "halt"),
        (("reprapfirmware",), "Warning: VIN under-voltage event (10.2V)", "fault"),
        (("reprapfirmware",), "Warning: MCU temperature warning", "notice"),
        (("klipper",), "// Klipper state: Shutdown", "halt"),
        (("klipper",), "!! Move out of range: 501.000 0.000 0.000 [0.000]", "refusal"),
        (("klipper",), "!! Lost communication with MCU 'mcu'", "fault"),
    ],
)
def test_known_messages_mean_what_their_firmware_does(families, text, meaning):
    known = load_messages(*families).find(text.encode())
    assert known is not None
    assert known.meaning is MessageMeaning(meaning)


def test_an_error_behind_a_question_that_is_not_known_is_not_excused(tmp_path):
    class Faulty(FakeDuet):
        def do(self, command: str) -> str:
            if command.startswith("M220"):
                return "Error: M220: Command is not supported\nError: Heater 1 fault: x\nok\n"
            return super().do(command)

    status = family_streamer("reprapfirmware", Faulty(), tmp_path, FAMILY_JOB).run()
    assert status.state is LinkState.FAILED
    assert "Heater 1 fault" in status.message


# --- error message split between two reads: no line is sent before its end
RRF = partial(RrfProtocol, places)
ERRORS = [
    (KlipperProtocol, b"!! Move out of range: 501.000 0.000 0.000 [0.000]\n"),
    (KlipperProtocol, b'// Unknown command:"G1"\n'),
    (KlipperProtocol, b"// Klipper state: Shutdown\n"),
    (RRF, b"Error: G1: outside machine limits\n"),
    (RRF, b"Warning: motor was not driven because it failed\n"),
    (MarlinProtocol, b"Error:Heating failed\n"),
    (MarlinProtocol, b"echo: cold extrusion prevented\r\n"),
    (partial(MarlinProtocol, pairing=Pairing(128)), b"Error:Heating failed\n"),
]
CUTS = [(family, said, cut) for family, said in ERRORS for cut in range(1, len(said))]


@pytest.mark.parametrize(("family", "said", "cut"), CUTS)
def test_no_line_leaves_between_the_halves_of_an_error_behind_the_ok(family, said, cut):
    protocol, sent = in_flight(family)
    protocol.feed(b"ok\n" * sent + said[:cut], 0.1)
    assert b"G1" not in protocol.take_output()
    events = protocol.feed(said[cut:], 0.11)
    assert any(isinstance(event, (Fault, FirmwareHalted, Halting)) for event in events)
    assert_nothing_leaves(protocol)


@pytest.mark.parametrize(("family", "said", "cut"), CUTS)
def test_no_line_leaves_between_the_halves_of_an_error_before_the_ok(family, said, cut):
    protocol = streaming(family)
    protocol.feed(said[:cut], 0.1)
    assert b"G1" not in protocol.take_output()
    events = protocol.feed(said[cut:] + b"ok\n", 0.11)
    assert any(isinstance(event, (Fault, FirmwareHalted, Halting)) for event in events) or (
        not protocol.idle  # Marlin is asked what became of the line, and then told of
    )
    assert b"G1" not in protocol.take_output()


@pytest.mark.parametrize(("family", "said", "cut"), CUTS)
def test_a_half_whose_other_half_is_late_by_seconds_lets_no_line_of_the_job_go(family, said, cut):
    protocol, sent = in_flight(family)
    protocol.feed(b"ok\n" * sent + said[:cut], 0.1)
    for step in range(1, 60):
        protocol.tick(0.1 + step * 0.1)
        assert b"G1" not in protocol.take_output()
    protocol.feed(said[cut:], 6.2)
    assert b"G1" not in protocol.take_output()


@pytest.mark.parametrize("family", [KlipperProtocol, RRF, MarlinProtocol])
def test_the_job_goes_on_once_a_cut_text_is_whole(family):
    protocol = streaming(family)
    protocol.feed(b"ok\nT:21", 0.1)
    assert b"G1" not in protocol.take_output()
    protocol.feed(b".0 /0.0\n", 0.11)
    assert b"G1 X2" in protocol.take_output()


# --- error, halt or reset right behind an ok in the same read: no further line is sent
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


@pytest.mark.parametrize(("family", "said"), FAULTS)
def test_no_further_line_leaves_where_an_error_is_behind_the_ok(family, said):
    protocol = streaming(family)
    events = protocol.feed(said, 0.1)
    assert [event.line for event in events if isinstance(event, Fault)] == [1]
    assert (protocol.idle, protocol.lines_done) == (True, 1)
    assert_nothing_leaves(protocol)
    assert protocol.lines_done == 1


@pytest.mark.parametrize(("family", "said"), GLUED)
def test_an_ok_glued_to_an_error_is_both_answer_and_error(family, said):
    protocol = streaming(family)
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
    protocol = streaming(family)
    events = [*protocol.feed(said, 0.1), *protocol.tick(9.0)]
    assert isinstance(events[-1], end)
    assert protocol.lines_done == 1
    assert_nothing_leaves(protocol)


@pytest.mark.parametrize("family", [KlipperProtocol, RRF, MarlinProtocol])
def test_a_command_that_waits_leaves_once_the_error_is_heard_and_the_job_once_it_may(family):
    protocol = streaming(family)
    protocol.submit(b"M114", 0.05)
    protocol.feed(b"ok\necho: cold extrusion prevented\nError: it is cold\n!! cold\n", 0.1)
    assert re.search(rb"M0?114", protocol.take_output())
    protocol.feed(b"X:1.00 Y:0.00 Z:0.00 E:0.00\nok\n", 0.2)
    protocol.held = False
    protocol.go(0.3)
    assert b"G1 X2" in protocol.take_output()
