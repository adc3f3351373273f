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
