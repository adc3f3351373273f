"""Reading of whole G-code files, against line-by-line reading and a slow oracle."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_profiles import Printer, load
from sim.errors import GcodeError, LineError
from sim.gcode.dry_run.run import dry_run
from sim.gcode.program.gcode import parse_line, read_gcode
from sim.gcode.reading import read_line
from sim.gcode.reading.file import kinds_of, read_file
from tests.sim.gcode.reading.test_read_line import FAMILIES, anything, lines
from tests.slower import examples

MARLIN = load(Printer, "generic_marlin")
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
        line = read_line(text, MARLIN)
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
        line = read_line(text, MARLIN)
    except LineError:
        return
    assert naive_move(text.decode()) == (line.code, dict(line.words))


def test_a_binary_file_is_named():
    with pytest.raises(GcodeError, match=r"line 2 of the G-code has a NUL \(byte 6\)"):
        read_file(b"G1\nG1 \0", MARLIN)


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
