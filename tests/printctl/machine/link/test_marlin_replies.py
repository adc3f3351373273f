"""Interpretation of a real Marlin's replies, and framing of lines to it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_profiles.families.marlin.replies import Kind, classify, frame


@pytest.mark.parametrize(
    ("text", "kind", "number"),
    [
        (b"ok", Kind.OK, -1),
        (b"ok T:-15.00 /0.00 B:-15.00 /0.00 @:0 B@:0", Kind.OK, -1),
        (b"ok N18 P0 B0", Kind.OK, 18),
        (b"ok P15 B3", Kind.OK, -1),
        (b"okok", Kind.JUNK, -1),
        (b"oj", Kind.JUNK, -1),
        (b"Resend: 25", Kind.RESEND, 25),
        (b"Resend: 2?", Kind.TEXT, -1),
        (b"Error:checksum mismatch, Last Line: 24", Kind.ERROR, 24),
        (b"Error:MINTEMP triggered, system stopped! Heater_ID: E0", Kind.FAULT, -1),
        (b"Error:Printer halted. kill() called!", Kind.HALT, -1),
        (b"echo:busy: processing", Kind.BUSY, -1),
        (b"echo:busy: paused for user", Kind.BUSY, -1),
        (b'echo:Unknown command: "\x80\xff\x01G1"', Kind.UNKNOWN_COMMAND, -1),
        (b"echo: cold extrusion prevented", Kind.REFUSAL, -1),
        (b"//action:notification Settings Stored", Kind.ACTION, -1),
        (b"start", Kind.START, -1),
        (b"Marlin bugfix-2.1.x", Kind.START, -1),
        (b"wait", Kind.WAIT, -1),
        (b" T:-15.00 /0.00 B:-15.00 /0.00 @:0 B@:0", Kind.REPORT, -1),
        (b"X:0.00 Y:0.00 Z:0.00 E:5.00 Count X:800 Y:0 Z:0", Kind.REPORT, -1),
        (b"  M92 X80.00 Y80.00 Z400.00 E500.00", Kind.TEXT, -1),
    ],
)
def test_recorded_forms(text, kind, number):
    reply = classify(text)
    assert (reply.kind, reply.number) == (kind, number)


@given(st.binary(max_size=80))
def test_any_bytes_are_classified(text):
    assert classify(text).text == text


@given(st.integers(0, 7), st.integers(0, 1))
def test_a_garbled_ok_is_never_an_ok(bit, place):
    text = bytearray(b"ok")
    text[place] ^= 1 << bit
    assert classify(bytes(text)).kind is not Kind.OK


def test_frames_are_the_recorded_ones():
    assert frame(0, b"M110 N0") == b"N0 M110 N0*125\n"
    assert frame(1, b"M105") == b"N1 M105*38\n"
    assert frame(3, b"G1 X2") == b"N3 G1 X2*97\n"
