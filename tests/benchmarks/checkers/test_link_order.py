import numpy as np
import pytest

from benchmarks.checkers.link_order import Taken, body_of, judge, unreached

FILE = [b"G1 X1", b"G1 X2", b"G1 X3"]


def taken(*texts: bytes) -> list[Taken]:
    """Each under the number of its place, as it was meant."""
    return [Taken(float(n), b"N%d %b*1" % (n, text), text) for n, text in enumerate(texts, 1)]


def counts(rows: list[Taken]) -> tuple[int, int, int, int, int]:
    found = judge(FILE, rows)
    return found.lost, found.doubled, found.swapped, found.slipped, found.strays


def test_body_is_read_with_and_without_number_and_checksum():
    assert body_of(b"N12 G1 X1*45") == (12, b"G1 X1")
    assert body_of(b"N-1 M110*3") == (-1, b"M110")
    assert body_of(b"M105") == (None, b"M105")
    assert body_of(b"\x0bN999\x199 M105*23")[0] is None  # a fragment behind a control character


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        (taken(b"G1 X1", b"M114", b"G1 X2", b"G1 X3"), (0, 0, 0, 0, 0)),
        (taken(b"G1 X1", b"G1 X3"), (1, 0, 0, 0, 0)),
        (taken(b"G1 X1", b"G1 X1", b"G1 X2", b"G1 X3"), (0, 1, 0, 0, 0)),
        (taken(b"G1 X2", b"G1 X1", b"G1 X3"), (0, 0, 1, 0, 0)),
        ([*taken(b"G1 X1"), Taken(0.0, b"N0 M110 N0*1", b"M110 N0"), *taken(*FILE)], (0,) * 5),
    ],
    ids=["once and in order", "lost", "doubled", "swapped", "before the last renumbering"],
)
def test_lost_doubled_and_swapped_lines_are_counted(rows, found):
    assert counts(rows) == found


def test_lines_after_the_end_are_unfinished_not_lost():
    found = judge(FILE, taken(b"G1 X1", b"G1 X2"))
    assert (found.lost, found.unfinished) == (0, 1)


def test_slipped_line_is_counted_and_keeps_its_place():
    rows = taken(*FILE)
    rows[1] = Taken(2.0, b"N2 G1 X6*1", b"G1 X2")
    assert counts(rows) == (0, 0, 0, 1, 0)


def test_stray_command_is_unverified_until_the_position_was_asked():
    stray = Taken(1.5, b"G1 X9", None)
    one, two, three = taken(*FILE)
    asked = Taken(1.6, b"N2 M114*1", b"M114")
    assert judge(FILE, [one, stray, two, three]).unverified == 1
    assert judge(FILE, [one, stray, asked, two, three]).unverified == 0
    assert judge(FILE, [one, Taken(1.5, b"87", None), two, three]).unverified == 0


def test_longest_gap_is_between_lines_of_the_file():
    rows = taken(*FILE)
    rows[2] = Taken(9.0, rows[2].text, rows[2].meant)
    assert judge(FILE, rows).longest_gap_s == 7.0


def test_unreached_ends_and_surplus_moves():
    ends = np.array([[1, 0, 0, 1], [2, 0, 0, 2], [3, 0, 0, 3]])
    assert unreached(ends, ends) == (0, 0)
    assert unreached(ends, ends[[0, 2]]) == (1, 0)
    assert unreached(ends, ends[[0, 1, 1, 2]]) == (0, 1)
    assert unreached(ends, ends[[1, 0, 2]]) == (1, 1)
