"""Places at which looks are due: by way, time of writing and height; ends of lines in layers."""

from __future__ import annotations

import pytest

from printctl.machine.link.care import Care
from printctl.machine.link.look_places import Written, look_places
from tests.printctl.machine.link.jobs import parse_job


def spaced(layers=2, lines=3, mark="LAYER_END", relieves=True, wipes=False):
    """Lines of 10 mm at 10 mm/s in layers of 0.25 mm, each left by a travel."""
    text, e = ["G90", "M82", "G92 X0 Y0 Z5 E0"], 0.0
    for layer in range(layers):
        z = 1 + 0.25 * layer
        for k in range(lines):
            x = k % 2 * 10
            text += [f"G0 X{x} Y{k} F6000", f"G1 Z{z:g} F300"]
            text += [f"G1 E{e:.4f} F60"] * relieves
            e += 0.1
            text.append(f"G1 X{10 - x} E{e:.4f} F600")
            text += [f"G0 X{10 - x} Y{k + 0.2} F6000"] * wipes
            text += [f"G1 E{e - 0.05:.4f} F60"] * relieves
            text.append(f"G0 Z{z + 0.5:g} F300")
        text.append(f";{mark}:{layer}")
    return parse_job(("\n".join(text) + "\nG0 X50 F600\n").encode(), "a")


def places(job, within=True):
    return look_places(job.lines, job.marks, job.positions, within=within)


@pytest.mark.parametrize(("relieves", "wipes"), [(True, False), (False, False), (True, True)])
def test_lines_end_where_the_needle_leaves_the_ink_relieved_and_lifted(relieves, wipes):
    job = spaced(relieves=relieves, wipes=wipes)
    found = places(job)
    assert [round(one.way_mm) for one in found.written] == [10, 20, 30, 40, 50, 60]
    assert found.marked == [False, False, True] * 2
    for index in found.index:
        assert job.lines[index - 1].startswith(b"G0 Z"), "not before it is relieved and lifted"
        assert job.lines[index].startswith(b"G0 X")


def test_a_path_that_turns_is_never_interrupted():
    text = "G90\nG92 X0 Y0 Z1 E0\n" + "".join(
        f"G1 X{k % 2 * 5} Y{k} E{k * 0.1:g} F600\n" for k in range(1, 9)
    )
    job = parse_job((text + "G0 Z2 F300\n;LAYER_END:0\nG0 X50 F600\n").encode(), "a")
    assert places(job).index == [len(job.lines) - 1]


def test_in_a_bath_only_passes_end():
    job = spaced(mark="PASS_END")
    assert places(job).index == [mark.index for mark in job.marks.all]


@pytest.mark.parametrize(
    ("care", "mm"),
    [
        (Care(look_every_mm=15.0), [20, 40, 60]),
        (Care(look_every_written_s=1.5), [20, 40, 60]),
        (Care(look_every_height_mm=0.5), [60 + 30, 60 + 90]),
        (Care(look_every_height_mm=0.25), [60, 90, 120, 150]),
        (Care(look_every_height_mm=9.0), []),
    ],
)
def test_a_look_is_due_behind_enough_way_time_or_height(care, mm):
    job = spaced(5 if care.look_every_height_mm else 2)
    found, looked, first, seen = places(job), Written(), 0, []
    while (index := found.next_due(first, looked, care)) is not None:
        looked, first = found.at(index), index + 1
        seen.append(round(looked.way_mm))
    assert seen == mm


def seen_s(found, first=0, looked=None):
    """Writing times of the looks that follow."""
    looked, care, seen = looked or Written(), Care(None, look_every_written_s=30.0), []
    while (index := found.next_due(first, looked, care)) is not None:
        looked, first = found.at(index), index + 1
        seen.append(round(looked.time_s))
    return seen


def test_looks_by_writing_time_come_soon_after_the_start_and_after_a_change():
    job = spaced(layers=1, lines=120)
    found = places(job)
    assert seen_s(found) == [10, 20, 40, 70, 100]
    at = found.index[39]  # a flow is corrected there, without a line
    changed = found.shifted(at, 0)
    assert seen_s(changed, at + 1, changed.at(at)) == [50, 60, 80, 110]
