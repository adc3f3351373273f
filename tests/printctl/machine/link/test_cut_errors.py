"""Error message split between two reads: no line is sent before its end."""

from __future__ import annotations

from functools import partial

import pytest

from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import Fault, FirmwareHalted, Halting
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.pairing import Pairing
from firmware_profiles.families.reprapfirmware.facts import RrfProtocol
from printctl.machine.link.modal import places

JOB = [b"G1 X%d" % k for k in range(1, 101)]
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


def streaming(family):
    protocol = family()
    protocol.load(JOB, 0, 0)
    protocol.held = False
    protocol.go(0.0)
    return protocol, protocol.take_output().count(b"G1")


@pytest.mark.parametrize(("family", "said", "cut"), CUTS)
def test_no_line_leaves_between_the_halves_of_an_error_behind_the_ok(family, said, cut):
    protocol, in_flight = streaming(family)
    protocol.feed(b"ok\n" * in_flight + said[:cut], 0.1)
    assert b"G1" not in protocol.take_output()
    events = protocol.feed(said[cut:], 0.11)
    assert any(isinstance(event, (Fault, FirmwareHalted, Halting)) for event in events)
    assert b"G1" not in protocol.take_output()
    for second in range(1, 50):
        protocol.feed(b"ok\n", second)
        protocol.tick(float(second))
        assert b"G1" not in protocol.take_output()


@pytest.mark.parametrize(("family", "said", "cut"), CUTS)
def test_no_line_leaves_between_the_halves_of_an_error_before_the_ok(family, said, cut):
    protocol, _ = streaming(family)
    protocol.feed(said[:cut], 0.1)
    assert b"G1" not in protocol.take_output()
    events = protocol.feed(said[cut:] + b"ok\n", 0.11)
    assert any(isinstance(event, (Fault, FirmwareHalted, Halting)) for event in events) or (
        not protocol.idle  # Marlin is asked what became of the line, and then told of
    )
    assert b"G1" not in protocol.take_output()


@pytest.mark.parametrize(("family", "said", "cut"), CUTS)
def test_a_half_whose_other_half_is_late_by_seconds_lets_no_line_of_the_job_go(family, said, cut):
    protocol, in_flight = streaming(family)
    protocol.feed(b"ok\n" * in_flight + said[:cut], 0.1)
    for step in range(1, 60):
        protocol.tick(0.1 + step * 0.1)
        assert b"G1" not in protocol.take_output()
    protocol.feed(said[cut:], 6.2)
    assert b"G1" not in protocol.take_output()


@pytest.mark.parametrize("family", [KlipperProtocol, RRF, MarlinProtocol])
def test_the_job_goes_on_once_a_cut_text_is_whole(family):
    protocol, _ = streaming(family)
    protocol.feed(b"ok\nT:21", 0.1)
    assert b"G1" not in protocol.take_output()
    protocol.feed(b".0 /0.0\n", 0.11)
    assert b"G1 X2" in protocol.take_output()


@pytest.mark.parametrize("family", [KlipperProtocol, RRF])
def test_the_job_goes_on_where_a_harmless_text_is_never_ended(family):
    protocol, _ = streaming(family)
    protocol.feed(b"ok\nT:21", 0.1)
    protocol.tick(protocol.deadline)
    assert b"G1 X2" in protocol.take_output()


def test_a_text_that_is_never_ended_is_followed_by_a_token_and_then_by_the_job():
    protocol, _ = streaming(MarlinProtocol)
    protocol.feed(b"ok\nT:21", 0.1)
    protocol.tick(protocol.deadline)
    sent = protocol.take_output()
    assert b"G1" not in sent
    token = sent.split(b"E1 ")[1].split(b"*")[0]
    protocol.feed(b"\n" + token + b"\nok\n", 1.0)
    assert b"G1 X2" in protocol.take_output()
