"""Reading of G-code lines and files, by firmware family."""

import random
import re
from functools import reduce
from operator import xor

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_profiles import Printer, load, shipped
from gcode.dry_run.run import dry_run
from gcode.errors import GcodeError, LineError
from gcode.program.gcode import parse_line, read_gcode
from gcode.reading import read_line, read_sent
from gcode.reading.file import kinds_of, read_file
from gcode.reading.line import SORTS
from gcode.reading.read import PLAIN_MOVE, read_words
from tests.slower import examples

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


BEHIND_ANY_CODE = [b"M4321 M104 S250", b"M4321 G1 Z-5", b"T0 M104 S250"]
SECOND_COMMAND_IN_A_TEXT = (
    [b'M117 "x"M104 S250', b'M117 "x" G1 Z-50 F3000', b'M117 "x"G10 P0 S300', b'M117 a"b"M104 S250']
    + [b'M117 "x""y"M104 S250', b'M118 S"a" M104 S250', b'M118 S"a""b"M104 S250', b"M0 M104 S250"]
    + [b"M118 hi M104 S250", b'M98 P"a.g"G1 Z-5', b"M98 Pa.g M104 S250", b"G1 X1 G1 Y2"]
    + [b"M104 S0 M140 S0", b'M117 "a;b"M104 S250', b"M84 M104 S250", b"M201 X5 G1 Z-5"]
    + [b'M106 C"x"M104 S250', b"M28 \"x\"M104 S250"]
)  # fmt: skip
READ_OTHERWISE = [
    ("prusa", b"g1 x5"), ("klipper", b"G4 S2"), ("klipper", b"G2 X1 Y1 R5"),
    ("reprapfirmware", b"G1X1E3"), ("reprapfirmware", b"G1 H2 X5"),
]  # fmt: skip
READ_OTHERWISE += [("reprapfirmware", text) for text in SECOND_COMMAND_IN_A_TEXT]
READ_OTHERWISE += [(family, text) for family in FAMILIES for text in BEHIND_ANY_CODE]


@pytest.mark.parametrize(("family", "text"), READ_OTHERWISE)
def test_families_refuse_what_they_read_otherwise_and_a_second_command(family, text):
    with pytest.raises(LineError):
        read_line(text, FAMILIES[family])


@pytest.mark.parametrize("name", shipped(Printer))
def test_commands_of_every_profile_are_canonical(name):
    printer = load(Printer, name)
    commands = [*printer.safe_state_off, *(item.query for item in printer.watch)]
    commands += [one for air in printer.airs for one in (air.opens, air.closes)]
    commands += [one for pair in printer.pressure_pairs.values() for one in pair]
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


# Whole files, against line-by-line reading and a slow oracle


GENERIC = load(Printer, "generic_marlin")
files = st.lists(st.one_of(lines, anything), max_size=12).map(b"\n".join).filter(
    lambda data: b"\0" not in data
)  # fmt: skip


def by_lines(data: bytes, printer: Printer) -> tuple[list[bytes], list[int]]:
    """Each line by itself."""
    sent, refused = [], []
    for number, text in enumerate(data.splitlines(), 1):
        try:
            sent.append(read_line(text, printer).text)
        except LineError:
            sent.append(b"")
            refused.append(number)
    return sent, refused


@given(files, st.sampled_from(sorted(FAMILIES)))
def test_a_file_is_read_as_its_lines_are(data, family):
    file = read_file(data, FAMILIES[family])
    assert (file.lines, [line for line, _ in file.refused]) == by_lines(data, FAMILIES[family])
    assert sum(count for *_, count in kinds_of(file.refused)) == len(file.refused)


@given(lines)
def test_the_kernel_reads_of_a_line_what_the_reader_read(text):
    try:
        line = read_line(text, GENERIC)
    except LineError:
        return
    command = parse_line(line.text)
    assert command.name == line.code
    assert command.values == {a: v for a, v in line.words.items() if v is not None}


def naive_move(text: str) -> tuple[str, dict[str, float]] | None:
    """A plain line of blanks, letters and numbers, by splitting at each letter."""
    bare = text.split(";")[0].replace(" ", "").replace("\t", "").upper()
    words = re.findall(r"[A-Z][^A-Z]*", bare)
    if "".join(words) != bare or not words:
        return None
    return words[0][0] + str(int(words[0][1:])), {word[0]: float(word[1:]) for word in words[1:]}


@given(lines)
def test_words_are_those_of_a_slow_oracle(text):
    try:
        line = read_line(text, GENERIC)
    except LineError:
        return
    assert naive_move(text.decode()) == (line.code, dict(line.words))


def test_a_binary_file_is_named():
    with pytest.raises(GcodeError, match=r"line 2 of the G-code has a NUL \(byte 6\)"):
        read_file(b"G1\nG1 \0", GENERIC)


WORDS = ("G1", "G0", "G2", "G3", "G92", "G90", "G91", "M82", "M83", "G4", "G28", "M104", "T0", "N1",
         "X", "Y", "Z", "E", "F", "I", "J", "R", "P", "S", "1", "-2.5", "999999", "1e9", ".", "--",
         "nan", "inf", "12345678901234567890", "0x10", "*7", ";", "(", ")", '"', "\t", " ", "\r",
         "{1}", "=", "SET_PIN", "M117 M110", "\\", "\x7f", "é")  # fmt: skip


def fuzzed(rng: random.Random) -> bytes:
    """A file of few lines, from nearly lawful to noise."""
    rows = []
    for _ in range(rng.randrange(6)):
        blank = rng.choice(("", " "))
        rows.append(blank.join(rng.choices(WORDS, k=rng.randrange(1, 8))).encode("latin-1"))
    data = bytearray(b"\n".join(rows))
    for _ in range(rng.choice((0, 0, 0, 3))):
        if data:
            data[rng.randrange(len(data))] = rng.randrange(1, 256)
    return bytes(data)


def run_fuzz(count: int, seed: int) -> None:
    """No exception, and nothing beyond the machine without a finding."""
    rng, printers = random.Random(seed), sorted(FAMILIES.items())
    for _ in range(count):
        data, (_, printer) = fuzzed(rng), rng.choice(printers)
        run = dry_run(data, printer, (10.0, 10.0, 10.0), cold_extrusion=True)
        assert np.isfinite(run.program.target).all(), data
        if not len(run.program):
            assert run.findings, data
        sent, refused = by_lines(data, printer)
        assert bool(refused) <= bool(run.findings), data
        assert set(run.program.line.tolist()) <= {n for n, text in enumerate(sent, 1) if text}, data


def test_fuzzed_files_are_read_or_refused():
    run_fuzz(300, 1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_very_many_fuzzed_files_are_read_or_refused(seed):
    run_fuzz(50_000, 1000 + seed)


@settings(max_examples=examples(30))
@given(st.binary(max_size=200))
@example(b"\xff\xfeG\0")
@example(b"G1 X\0")
def test_the_kernel_takes_any_bytes_that_are_text(data):
    if b"\0" in data or data.startswith((b"\xff\xfe", b"\xfe\xff")):
        with pytest.raises(GcodeError):
            read_gcode(data)
        return
    program = read_gcode(data)
    assert len(program.line) == len(program.kind)
