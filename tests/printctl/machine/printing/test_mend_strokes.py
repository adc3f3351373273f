"""Lines of inserts for the live view: where they write, and whether they are executed."""

from __future__ import annotations

from printctl.machine.link.inserts import Insert
from printctl.machine.link.marks import MarkKind
from printctl.machine.printing.mend_strokes import mend_strokes
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import layered
from tests.printctl.machine.link.looking import at_end, patch


def grown(*flows: float):
    data = layered(2, 12)
    job = parse_job(data, "a")
    mark = next(one for one in job.marks.of(MarkKind.LAYER) if one.number == 0)
    lines = [line.partition(";")[0].strip().encode() for line in patch(data, 0)]
    return job.grown(Insert(1, mark.index, tuple(lines), "a gap", 1.0)), mark.index, len(lines)


def test_a_mend_is_its_writing_way_at_its_height():
    job, after, count = grown()
    (mend,) = mend_strokes(job)
    z = at_end(job.lines, after)["Z"]
    ((begin, end),) = mend.strokes
    assert begin == (51.5, 50.25, round(z - 0.1, 3))
    assert end == (52.5, 50.25, round(z - 0.1, 3))
    assert (mend.look, mend.last) == (1, after + count)
    assert not mend.to_dict(after + count - 1)["written"]
    assert mend.to_dict(after + count)["written"]


def test_a_corrected_flow_alone_writes_no_mend():
    data = layered(2, 12)
    job = parse_job(data, "a")
    assert mend_strokes(job.grown(Insert(1, 5, (), "thin", 1.1))) == []


def test_ways_that_follow_each_other_are_one_line_and_travels_part_them():
    data = layered(2, 12)
    job = parse_job(data, "a")
    at = at_end(job.lines, 8)
    e = at["E"]
    lines = [
        b"G1 X51 Y51 F600",
        b"G1 X52 E%.5f" % (e + 0.1),
        b"G1 Y52 E%.5f" % (e + 0.2),
        b"G1 X50 Y50",
        b"G1 E%.5f" % (e + 0.3),
        b"G1 X49 E%.5f" % (e + 0.4),
        b"G92 E%.5f" % e,
        b"G1 X%g Y%g F%g" % (at["X"], at["Y"], at["F"]),
    ]
    (mend,) = mend_strokes(job.grown(Insert(1, 8, tuple(lines), "a gap", 1.0)))
    ways = [[(x, y) for x, y, _ in stroke] for stroke in mend.strokes]
    assert ways == [[(51, 51), (52, 51), (52, 52)], [(50, 50), (49, 50)]]
