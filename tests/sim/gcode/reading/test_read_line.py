"""Reading of single G-code lines, by firmware family."""

from __future__ import annotations

import re
from functools import reduce
from operator import xor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_profiles import Printer, load, shipped
from sim.errors import LineError
from sim.gcode.reading import read_line, read_sent
from sim.gcode.reading.line import SORTS
from sim.gcode.reading.read import PLAIN_MOVE, read_words

MARLIN, KLIPPER = load(Printer, "marlin_avr"), load(Printer, "klipper_bioprinter")
DUET = load(Printer, "makergear_m2_duet2")
PRUSA = MARLIN.model_copy(update={"firmware": "prusa"})
FAMILIES = {p.firmware: p for p in (MARLIN, PRUSA, DUET, KLIPPER)}


def numbered(text: bytes) -> bytes:
    return b"%b*%d" % (text, reduce(xor, text, 0))


@pytest.mark.parametrize(
    ("text", "sent"),
    [
        (b"G1 X1.5 E0.2\r\n", b"G1 X1.5 E0.2"),
        (b"G 1 Z-50", b"G1 Z-50"),
        (b"  G01\tX 10Y+5 ; to the side", b"G1 X10 Y5"),
        (b"g1 x.5 y-.25 f600.", b"G1 X0.5 Y-0.25 F600"),
        (b"G1X1Y2Z3", b"G1 X1 Y2 Z3"),
        (b"G1 X1 (aside) Y2", b"G1 X1 Y2"),
        (b"(only this)", b""),
        (b"N12", b""),
        (numbered(b"N12 G1 X1"), b"G1 X1"),
        (numbered(b"G1 X1 "), b"G1 X1"),
        (numbered(b"N7G1X1") + b" ; checked", b"G1 X1"),
        (b"G28 X Y0", b"G28 X Y0"),
        (b"M117  two lines, 5 mL", b"M117 two lines, 5 mL"),
        (b"M117", b"M117"),
        (b"m0400", b"M400"),
        (b"G2 X1 Y0 I.5 J0", b"G2 X1 Y0 I0.5 J0"),
        (b"M4321 Q7 W", b"M4321 Q7 W"),
        (b"", b""),
        (b"; a remark with \xc3\xb6", b""),
    ],
)
def test_a_line_is_sent_as_it_was_understood(text, sent):
    line = read_line(text, MARLIN)
    assert line.text == sent
    assert bool(line) == bool(sent)


REFUSED = {
    "bad_number": [b"G1 X--5", b"G1 X1.2.3", b"G1 Xnan", b"G1 Xinf", b"G1 X", b"G1 X1 2"]
    + [b"G1 X- 5", b"G1 X1e-5", b"G1 X1,5", b"G1 X{move.axes[0].max}", b'G1 X"5"'],
    "huge_number": [b"G1 X12345678901234567890", b"G1 X0.0000000000000001", b"G1 X1000001"],
    "unknown_axis": [b"G1 X110 A-30", b"G1 X1 Q7"],
    "unknown_word": [b"G1 X1 S7", b"G90 G1 X5", b"G1 X5mm"],
    "repeated_word": [b"G1 X1 X2"],
    "bad_code": [b"G65537 X5", b"G92.1", b"G1.5 X3"],
    "ambiguous": [b"G92", b"G1 X5 F0", b"G4 P-1", b"G4 P1 S1", b"G2 X1 R5 I2", b"M104 T0.5 S20"]
    + [b"M220 S99.5", b"M117 M110 N0"],
    "no_command": [b"X5", b"%", b"hello", b"// a comment of Aerotech alone", b"@pause", b"N5 X5"],
    "bad_checksum": [b"N12 G1 X1*3", b"G1 X1*", b"NG1 X1"],
    "bad_comment": [b"G1 X1 (a(b)", b'M117 "a;b"'],
    "not_text": [b"G1 X5\x00", b"G1 X5\xb0", b"M117 a\\b", b"\xef\xbb\xbfG1 X5"],
}  # fmt: skip


@pytest.mark.parametrize(
    ("sort", "text"), [(sort, one) for sort in REFUSED for one in REFUSED[sort]]
)
def test_what_cant_be_read_is_refused_with_the_line_and_a_remedy(sort, text):
    with pytest.raises(LineError, match=r";|:") as caught:
        read_line(text, MARLIN)
    assert caught.value.sort == sort
    assert sort in SORTS


@pytest.mark.parametrize("printer", FAMILIES.values(), ids=FAMILIES)
@pytest.mark.parametrize(
    "text",
    [b"G1 X101" + b" " * 2000 + b"F600", b"M117 " + b"x" * 2000, b"(" * 2001, b"G1" + b" X1" * 700]
    + [b"N" + b"1" * 2000 + b" M105"],
)
def test_a_line_that_no_firmware_takes_is_refused_before_it_is_looked_at(text, printer):
    with pytest.raises(LineError, match="at most 2000 are read") as caught:
        read_line(text, printer)
    assert caught.value.sort == "too_long"
    assert read_line(b"G1 X1 ;" + text, printer).text == b"G1 X1"


@pytest.mark.parametrize(
    ("family", "text"),
    [
        ("prusa", b"g1 x5"),
        ("klipper", b"G4 S2"),
        ("klipper", b"G2 X1 Y1 R5"),
        ("reprapfirmware", b"G1X1E3"),
        ("reprapfirmware", b"G1 H2 X5"),
    ],
)
def test_families_refuse_what_they_read_otherwise(family, text):
    with pytest.raises(LineError):
        read_line(text, FAMILIES[family])


@pytest.mark.parametrize("name", shipped(Printer))
def test_commands_of_every_profile_are_canonical(name):
    printer = load(Printer, name)
    head = printer.pneumatic
    commands = [*printer.safe_state_off, *(item.query for item in printer.watch)]
    commands += [head.opens, head.closes] if head else []
    commands += [c for h in printer.heads for c in (h.select, h.raises, h.lowers) if c]
    for command in commands:
        assert read_line(command.encode(), printer).text == command.encode()


numbers = st.from_regex(rb"[+-]?([0-9]{1,7}\.?[0-9]{0,8}|\.[0-9]{1,8})", fullmatch=True)
blanks = st.sampled_from([b"", b" ", b"\t", b"  "])
words = st.tuples(
    st.sampled_from([b"X", b"Y", b"Z", b"E", b"F", b"x", b"A", b"S"]), blanks, numbers
)
lines = st.tuples(
    st.sampled_from([b"G1", b"G0", b"g1", b"G 1", b"G001", b"M104", b"G92", b"G4"]),
    st.lists(st.tuples(blanks, words).map(lambda t: t[0] + b"".join(t[1])), max_size=4),
    blanks,
).map(lambda t: t[0] + b"".join(t[1]) + t[2])
anything = st.one_of(
    lines, st.text("GMTNXYZEFgmx0123456789.+-*; ()\"\t=_", max_size=24).map(str.encode),
    st.binary(max_size=16),
)  # fmt: skip


@given(anything, st.sampled_from(sorted(FAMILIES)))
def test_what_is_sent_reads_as_what_was_meant(text, family):
    """Reading what is sent gives the same line, and nothing but a LineError comes out."""
    printer = FAMILIES[family]
    try:
        line = read_line(text, printer)
    except LineError:
        return
    assert read_line(line.text, printer) == line
    assert b'"' in line.text or read_sent(line.text) == line
    assert re.fullmatch(rb"[ -~]*", line.text)


@given(lines, st.sampled_from(sorted(FAMILIES)))
def test_the_short_road_reads_plain_moves_as_the_long_one(text, family):
    if PLAIN_MOVE.fullmatch(text):
        assert read_line(text, FAMILIES[family]) == read_words(text, FAMILIES[family])


@pytest.mark.parametrize(
    "text",
    [b'M117 "x"M104 S250', b'M117 "x" G1 Z-50 F3000', b'M117 "x"G10 P0 S300', b'M117 a"b"M104 S250']
    + [b'M117 "x""y"M104 S250', b'M118 S"a" M104 S250', b'M118 S"a""b"M104 S250', b"M0 M104 S250"]
    + [b"M118 hi M104 S250", b'M98 P"a.g"G1 Z-5', b"M98 Pa.g M104 S250", b"G1 X1 G1 Y2"]
    + [b"M104 S0 M140 S0", b'M117 "a;b"M104 S250', b"M84 M104 S250", b"M201 X5 G1 Z-5"]
    + [b'M106 C"x"M104 S250', b"M28 \"x\"M104 S250"],
)  # fmt: skip
def test_a_second_command_in_a_line_is_refused_where_the_firmware_would_carry_it_out(text):
    with pytest.raises(LineError):
        read_line(text, DUET)


@pytest.mark.parametrize(
    "text",
    [b"M117 {1} M104 S250", b"M117 {1} G1 Z-50 F6000", b"M117 {move.axes[0].max} M500", b"M117 {}"]
    + [b"M117 {1}{2} M104 S250", b"M117 (a) {1} M500", b"M117{1}M500", b'M117 {"x"} M500']
    + [b"M117\t{1}\tM500", b'M117 "{1}" M500', b"M117 a {b} M500", b"M117 a } M500"]
    + [b"M118 P0 S{1} M500", b"M98 P{1} M500", b"M117 {1", b"M28 {1} M500"],
)  # fmt: skip
def test_braces_in_a_text_are_refused_where_the_firmware_works_them_out(text):
    with pytest.raises(LineError, match=r"brace|closed quote|ends with its quote"):
        read_line(text, DUET)


@pytest.mark.parametrize(
    ("text", "sent"),
    [
        (b"M117 Layer M5, G1 next", b"M117 Layer M5, G1 next"),
        (b'M117 "Layer M5"', b'M117 "Layer M5"'),
        (b'M117 "a ""M5"" b"', b'M117 "a ""M5"" b"'),
        (b"M117 it's 'M104'", b"M117 it's 'M104'"),
        (b'M118 P0 S"M104 S250"', b'M118 P0 S"M104 S250"'),
    ],
)
def test_a_text_that_reaches_to_the_lines_end_passes(text, sent):
    assert read_line(text, DUET).text == sent


@pytest.mark.parametrize("printer", FAMILIES.values(), ids=FAMILIES)
@pytest.mark.parametrize("text", [b"M4321 M104 S250", b"M4321 G1 Z-5", b"T0 M104 S250"])
def test_a_second_command_behind_any_code_is_refused_in_each_family(text, printer):
    with pytest.raises(LineError):
        read_line(text, printer)
