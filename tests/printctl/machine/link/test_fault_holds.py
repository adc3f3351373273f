"""Error and ok in one read: no further job line is sent."""

from __future__ import annotations

from functools import partial

import pytest

from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import Fault
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.reprapfirmware.facts import RrfProtocol
from printctl.machine.link.modal import places

JOB = [b"G1 X%d" % k for k in range(1, 101)]
SAID = [
    (KlipperProtocol, b"!! Move out of range: 501.000 0.000 0.000 [0.000]\nok\n"),
    (KlipperProtocol, b'// Unknown command:"G1"\nok\n'),
    (partial(RrfProtocol, places), b"Error: G1: outside machine limits\nok\n"),
    (MarlinProtocol, b"echo: cold extrusion prevented\nok\n"),
]


@pytest.mark.parametrize(("family", "said"), SAID)
def test_no_further_line_leaves_behind_an_error_whose_ok_is_in_the_same_read(family, said):
    protocol = family()
    protocol.load(JOB, 0, 0)
    protocol.held = False
    protocol.go(0.0)
    assert b"G1 X1" in protocol.take_output()
    events = protocol.feed(said, 0.1)
    assert any(isinstance(event, Fault) for event in events)
    assert b"G1" not in protocol.take_output()
    for second in range(1, 100):
        protocol.feed(b"ok\n", second)
        protocol.tick(float(second))
        assert b"G1" not in protocol.take_output()
