"""Mends of layered prints."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.network_files.csv_format import read_network_csv
from firmware_profiles import Ink, Needle, Printer, Syringe, load
from firmware_profiles.materials.inks_and_baths import MeasuredLag
from gcode.deposit.lay import deposit
from gcode.dry_run.run import dry_run
from printctl.machine.job.insert_check import InsertPlace, JobReach, judged_lines
from printctl.machine.job.job import load_job
from printctl.machine.job.marks import MarkKind
from printctl.observe.mending import (
    Gap,
    HeldPrint,
    MendError,
    Voids,
    check_mend,
    checked_mend,
    plan_mend,
    written_paths,
)
from tests.printctl.observe.mending.small_jobs import (
    LAYER_MM,
    NEEDLE,
    SYRINGE,
    WIDTH_MM,
    bath_job,
    layered_job,
)
from tests.slower import first_of


@pytest.fixture(scope="module")
def held():
    return layered_job().held()


def last(held):
    return len(written_paths(held)) - 1


def tube(a, b, radius):
    return Voids(np.array([a], float), np.array([b], float), np.full((1, 2), radius))


def test_a_gap_is_written_again_as_the_job_wrote_it_and_ends_where_the_print_is_held(held):
    path = written_paths(held)[-1]
    gap = Gap(path.number, 7.0, 9.5)  # round a corner
    mend = plan_mend(held, [gap])
    (patch,) = mend.patches
    points, _, feed = patch.moves()
    assert np.allclose(points[1:3], path.points[1:3], atol=1e-9)  # both corners are kept
    assert set(feed) == {10.0}
    assert patch.before_mm == pytest.approx(WIDTH_MM, abs=0.15)
    assert patch.beyond_mm == pytest.approx(WIDTH_MM, abs=0.15)
    checked = check_mend(held, mend.lines, [gap])
    assert checked.passed
    assert checked.covered == 1.0
    assert checked.outside_mm < 0.01
    length = patch.to_mm - patch.from_mm
    assert mend.volume_ul == pytest.approx(length * path.e_per_mm[0] * held.ul_per_e, rel=0.2)


def test_the_needle_travels_above_the_layer_and_comes_down_straight(held):
    mend = plan_mend(held, [Gap(last(held), 1.0, 2.0), Gap(last(held), 20.0, 21.0)])
    top, z = 5.0 + 3 * LAYER_MM, None
    for line in mend.lines:
        words = {word[:1]: float(word[1:]) for word in line.decode().split()[1:]}
        aside = {"X", "Y"} & words.keys()
        if line.startswith(b"G0") and aside:
            assert z is not None
            assert z >= top + 2 * LAYER_MM - 1e-9
            assert "Z" not in words
        z = words.get("Z", z)


def test_ink_of_a_later_layer_is_never_gone_through(held):
    under = [one.number for one in written_paths(held) if one.points[0, 2] < 5.5]
    mend = plan_mend(held, [Gap(number, 1.0, 2.0) for number in under])
    assert not mend.lines
    assert all("later layer" in one.reason for one in mend.left)
    assert sum(one.length_mm for one in mend.left) == pytest.approx(len(under))


def test_a_lumen_is_never_entered_and_the_rest_of_the_gap_is_mended(held):
    path = written_paths(held)[-1]
    x, y, z = path.at(np.array([3.0]))[0]
    voids = tube((x, y, z - LAYER_MM / 2 - 1), (x, y, z - LAYER_MM / 2 + 1), 0.4)
    gap = Gap(path.number, 1.0, 5.0)
    mend = plan_mend(held, [gap], voids)
    assert len(mend.patches) == 2
    (left,) = mend.left
    assert "reach into a lumen" in left.reason
    checked = check_mend(held, mend.lines, [gap], voids)
    assert checked.passed
    assert checked.deepest_mm <= 0.05
    assert left.length_mm == pytest.approx(2 * (0.4 + WIDTH_MM / 2 - 0.05), abs=0.3)


def test_a_check_sees_an_insert_through_a_lumen(held):
    gap = Gap(last(held), 1.0, 5.0)
    mend = plan_mend(held, [gap])
    x, y, z = written_paths(held)[-1].at(np.array([3.0]))[0]
    assert check_mend(held, mend.lines, [gap], tube((x, y, z - 1), (x, y, z), 0.4)).lumens_entered


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda lines: [*lines, b"G0 X101"], "off_mm"),
        (lambda lines: [line for line in lines if not line.startswith(b"G92")], "off_mm"),
        (lambda lines: [*lines, b"M221 S110"], "refused"),
        (lambda lines: [*lines[:-1], b"G1 F77"], "same_modes"),
        (lambda lines: [b"G0 Z5.1", *lines], "ink_crossed"),
        (lambda lines: [*lines, b"G0 X900", b"G0 X100"], "beyond_limits"),
    ],
)
def test_a_check_sees_what_is_wrong(held, change, field):
    gap = Gap(last(held), 1.0, 2.0)
    mend = plan_mend(held, [gap])
    found = check_mend(held, change(list(mend.lines)), [gap])
    assert not found.passed
    assert bool(getattr(found, field)) is (field != "same_modes")


def test_a_mend_that_fails_its_check_has_no_lines(held, monkeypatch):
    gap = Gap(last(held), 1.0, 2.0)
    mend, check = checked_mend(held, [gap])
    assert mend.lines
    assert check.passed
    wrong = replace(check, lumens_entered=2)
    monkeypatch.setattr("printctl.observe.mending.plan.check_mend", lambda *args, **more: wrong)
    mend, check = checked_mend(held, [gap])
    assert (mend.lines, mend.patches) == ((), ())
    assert "2 pieces of ink in lumens" in mend.left[0].reason


def test_a_thin_stretch_is_filled_up_where_the_line_stands_as_high_as_its_layer(held):
    path = written_paths(held)[-1]
    gap = Gap(path.number, 1.0, 3.0, 0.25)
    mend = plan_mend(held, [gap])
    (patch,) = mend.patches
    assert (patch.from_mm, patch.to_mm) == (1.0, 3.0), "nothing comes upon sound ink"
    missing = 0.25 * 2.0 * path.e_per_mm[0] * held.ul_per_e
    assert mend.volume_ul == pytest.approx(missing, rel=0.15)
    assert check_mend(held, mend.lines, [gap]).passed
    lumen = tube([102.0, 100.0 - 0.35, 0], [102.0, 100.0 - 0.35, 20], 0.3)
    beside = plan_mend(held, [replace(gap, from_mm=0.1)], lumen)
    assert beside.left
    assert all("lumen" in one.reason for one in beside.left)


def test_a_print_held_within_a_stroke_goes_on_with_its_plunger_as_it_was():
    whole = layered_job().held()
    path = written_paths(whole)[-1]
    held = replace(whole, done=int(path.command[6]) + 1)
    assert held.relieved_e == 0.0
    gap = Gap(path.number, 1.0, 2.0)
    mend = plan_mend(held, [gap])
    assert mend.lines[0].startswith(b"G1 E")  # relieved before it leaves
    assert mend.lines[-3].startswith(b"G1 E")  # and primed where it goes on
    assert check_mend(held, mend.lines, [gap]).passed


def test_a_mend_is_taken_by_the_link(held):
    mend = plan_mend(held, [Gap(last(held), 1.0, 2.0)])
    place = InsertPlace(held.place, JobReach.of(held.lines, held.start_mm), held.printer)
    assert list(judged_lines([line.decode() for line in mend.lines], place, "insert")) == list(
        mend.lines
    )


@pytest.mark.parametrize("gap", [Gap(99, 0, 1), Gap(0, 1, 1), Gap(0, 0, 1e3), Gap(0, 0, 1, -1.0)])
def test_gaps_that_cannot_be_are_refused(held, gap):
    with pytest.raises(MendError):
        plan_mend(held, [gap])


def test_a_check_counts_the_sound_ink_that_an_insert_is_written_onto(held):
    path = written_paths(held)[-1]
    x, y, z = path.at(np.array([3.0]))[0]
    ahead = path.at(np.array([4.0]))[0] - path.at(np.array([3.0]))[0]
    beside = np.array([-ahead[1], ahead[0], 0.0]) * (WIDTH_MM / 2 + 0.52)
    axis = np.array([x, y, z - LAYER_MM / 2]) + beside
    voids = tube(axis - 2 * ahead, axis + 2 * ahead, 0.5)
    gap = Gap(path.number, 2.8, 3.2)
    insert = plan_mend(held, [gap]).lines
    assert not check_mend(held, insert, [Gap(path.number, 2.0, 4.0)], voids).lumens_entered
    assert check_mend(held, insert, [gap], voids).lumens_entered


# --- mends of filaments in a bath
DEEP = [(100, 100, 5), (106, 100, 5.5), (112, 102, 5)]
ABOVE = [(103, 97, 8), (103, 103, 8)]


def test_a_break_is_written_again_from_above():
    held = bath_job(DEEP).held()
    gap = Gap(0, 4.0, 6.5)
    mend = plan_mend(held, [gap])
    checked = check_mend(held, mend.lines, [gap])
    assert (len(mend.patches), mend.left) == (1, ())
    assert checked.passed
    assert checked.covered == 1.0


def test_what_lies_under_another_filament_stays_and_the_rest_is_mended():
    held = bath_job(DEEP, ABOVE).held()
    gap = Gap(0, 1.0, 5.0)
    mend = plan_mend(held, [gap])
    assert "another filament" in mend.left[0].reason
    assert len(mend.patches) == 2
    assert check_mend(held, mend.lines, [gap]).passed
    assert mend.left[0].length_mm == pytest.approx(2 * (0.155 + 0.2), abs=0.35)


def test_a_check_sees_a_shaft_through_ink():
    gap = Gap(0, 1.0, 5.0)
    lower = bath_job(DEEP).held()
    insert = plan_mend(lower, [gap]).lines
    later = bath_job(DEEP, ABOVE).held()
    moved = [line for line in insert if not line.startswith(b"G92")]
    assert check_mend(later, moved, [gap]).ink_crossed > 0


def test_vessels_that_the_job_writes_are_no_voids_and_others_are():
    held, gap = bath_job(DEEP).held(), Gap(0, 4.0, 6.5)
    own = np.array(DEEP, dtype=float)
    across = np.array([[105.0, 90, 5.4], [105, 110, 5.4]])
    start, end = (np.vstack([own[k : k + 2], across[k]]) for k in (0, 1))
    voids = Voids(start, end, np.full((3, 2), 0.2))
    mend = plan_mend(held, [gap], voids)
    assert len(mend.patches) == 2
    assert ["lumen" in one.reason for one in mend.left] == [True]
    assert check_mend(held, mend.lines, [gap], voids).passed


@pytest.mark.parametrize("upwards", first_of([True, False]))
def test_a_needle_never_comes_down_through_the_upright_ink_that_it_mends(upwards):
    upright = [(100, 100, 4), (100, 100, 9)]
    held = bath_job(upright if upwards else upright[::-1]).held()  # held straight above it
    gap = Gap(0, 2.0, 2.5)
    mend = plan_mend(held, [gap])
    assert not mend.lines
    assert "same path" in mend.left[0].reason


# --- gaps planned into the jobs of two examples
ROOT = Path(__file__).parents[4]


def planned(folder, name):
    words = [
        sys.executable,
        "-m",
        "printctl",
        "run",
        f"examples/{name}.yaml",
        "--until",
        "toolpath",
    ]
    subprocess.run([*words, "--out", str(folder)], cwd=ROOT, check=True, capture_output=True)
    return load_job(folder / "part.gcode", load(Printer, "generic_marlin"))


def held_at(job, mark, ink, needle):
    parts = load(Syringe, "hamilton_1ml"), load(Ink, ink), load(Needle, needle)
    style = "layered" if mark.kind is MarkKind.LAYER else "embedded"
    return HeldPrint(job.lines, mark.index, load(Printer, "generic_marlin"), *parts, style)


@pytest.mark.slow
def test_gaps_beside_the_channels_of_planar_fresh_are_mended(tmp_path):
    job = planned(tmp_path, "planar_fresh")
    mark = job.marks.of(MarkKind.LAYER)[25]
    held = held_at(job, mark, "collagen_fresh", "fresh_150um")
    network = read_network_csv(tmp_path / "network.csv", "mm")
    voids = Voids.from_network(network, (92.0, 96.0, 1.0))
    paths = written_paths(held)
    top = max(path.points[0, 2] for path in paths)
    longest = sorted((p for p in paths if p.points[0, 2] == top), key=lambda p: p.length_mm)[-5:]
    gaps = [Gap(p.number, p.length_mm / 3, p.length_mm / 3 + 0.6) for p in longest]
    mend = plan_mend(held, gaps, voids)
    checked = check_mend(held, mend.lines, gaps, voids)
    assert not mend.left
    assert checked.passed
    assert checked.covered == 1.0


@pytest.mark.slow
def test_breaks_of_a_trees_newest_vessel_are_mended(tmp_path):
    job = planned(tmp_path, "planar_tree")
    mended = []
    for mark in job.marks.of(MarkKind.VESSEL)[::3]:
        held = held_at(job, mark, "gelatin_sacrificial", "30g_50mm")
        path = written_paths(held)[-1]
        low, high = np.array([0.4, 0.7]) * path.length_mm
        gap = Gap(path.number, float(low), float(high))
        mend = plan_mend(held, [gap])
        checked = check_mend(held, mend.lines, [gap])
        assert checked.passed
        mended.append(checked.covered)
    assert np.mean(mended) > 0.85


# --- random gaps in random strokes: checks hold, and the deposited ink closes the gap
VOXEL_MM = 0.05


def wandering(rng, z, step_z=0.0):
    """A path of some turns, none of them sharp."""
    angle = rng.uniform(0, 2 * np.pi)
    at, points = np.array([rng.uniform(100, 106), rng.uniform(100, 106), z]), []
    for _ in range(rng.integers(2, 6)):
        points.append(at)
        angle += rng.uniform(-1, 1)
        way = [np.cos(angle), np.sin(angle), rng.uniform(-step_z, step_z)]
        at = at + rng.uniform(0.8, 3.0) * np.array(way)
    return points


def held_job(rng, layered):
    if not layered:
        return bath_job(*(wandering(rng, 6.0 + 2 * k, 0.25) for k in range(2))).held()
    job = layered_job(2)
    for k in range(3):
        job.stroke(wandering(rng, 5.0 + 3 * LAYER_MM), "LAYER_END:2" if k == 2 else "")
    return job.held()


def finely(executed):
    """The same motion in pieces of at most 0.05 mm."""
    way = np.linalg.norm(executed.end - executed.start, axis=1)
    parts = np.maximum(np.ceil(way / 0.05), 1).astype(int)
    row = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)
    low, high = number / parts[row], (number + 1) / parts[row]
    found = {name: value[row] for name, value in vars(executed).items()}
    for begin, end in (
        ("start", "end"), ("plunger_start", "plunger_end"), ("time_start", "time_end")
    ):  # fmt: skip
        one, other = found[begin], found[end]
        shares = [each.reshape(-1, *[1] * (one.ndim - 1)) for each in (low, high)]
        found[begin], found[end] = (one + share * (other - one) for share in shares)
    return replace(executed, **found)


def missing(held, gap, executed):
    """Blocks of the job whose middles lie in the gap."""
    path = written_paths(held)[gap.path]
    middle = (executed.start + executed.end) / 2
    rows = np.flatnonzero(np.isin(executed.line, path.command))
    found = np.zeros(len(executed), dtype=bool)
    for row in rows:
        along, _ = path.nearest_mm(middle[row])
        found[row] = gap.from_mm < along < gap.to_mm
    return found


def ink_along(held, insert, gap):
    """Share of ink in voxels along the gap's axis, with the job's own ink missing there."""
    path = written_paths(held)[gap.path]
    lines = b"\n".join([*held.lines[: held.done], *insert])
    executed = dry_run(lines, held.printer, held.start_mm, cold_extrusion=True).executed
    executed = finely(executed)
    left = ~missing(held, gap, executed)
    kept = replace(executed, **{name: value[left] for name, value in vars(executed).items()})
    laid = deposit(
        kept,
        held.syringe.area_mm2,
        VOXEL_MM,
        smoothing_mm=0.6,
        style=held.style,
        plunger_step_mm=1 / held.printer.steps_per_mm.e,
    )
    places = path.at(np.linspace(gap.from_mm, gap.to_mm, 25))
    if held.style == "layered":
        places = places - np.array([0, 0, LAYER_MM / 2])
    index = np.round((places - laid.origin_mm) / VOXEL_MM).astype(int)[:, ::-1]
    inside = ((index >= 0) & (index < laid.volume.shape)).all(axis=1)
    found = np.zeros(len(index))
    found[inside] = laid.volume[tuple(index[inside].T)] / 255
    return found


@pytest.mark.parametrize("layered", [True, False])
@given(seed=st.integers(0, 10**6))
@settings(max_examples=6, deadline=None)
def test_a_random_gap_is_closed_and_nothing_else_is_touched(layered, seed):
    rng = np.random.default_rng(seed)
    held = held_job(rng, layered)
    path = written_paths(held)[-1]
    length = min(path.length_mm, rng.uniform(0.2, 3.0))
    low = rng.uniform(0, path.length_mm - length)
    gap = Gap(path.number, low, low + length)
    mend = plan_mend(held, [gap])
    checked = check_mend(held, mend.lines, [gap])
    assert checked.passed, checked
    assert checked.outside_mm < 0.02
    if mend.left:  # a path that crosses itself above
        return
    assert checked.covered == 1.0
    if length > 1.0:  # round ends of what lies beside it close a shorter one
        assert ink_along(held, [], gap).min() < 0.5
    assert ink_along(held, mend.lines, gap).min() > 0.5


@given(seed=st.integers(0, 10**6))
@settings(max_examples=15, deadline=None)
def test_any_gaps_of_a_print_held_anywhere_pass_their_check(seed):
    rng = np.random.default_rng(seed)
    held = held_job(rng, bool(rng.integers(2)))
    held = replace(held, done=int(rng.integers(held.done - 6, held.done + 1)))
    lag = MeasuredLag(lag_s=0.3, syringe=SYRINGE.name, needle=NEEDLE.name)
    held = replace(held, ink=held.ink.model_copy(update={"lag": lag}))
    paths = written_paths(held)
    gaps = []
    for _ in range(rng.integers(1, 4)):
        path = paths[rng.integers(len(paths))]
        length = min(path.length_mm, rng.uniform(0.05, 3))
        low = rng.uniform(0, path.length_mm - length)
        thin = rng.random() < 0.2
        gaps.append(Gap(path.number, low, low + length, 0.4 if thin else 1.0))
    mend, check = checked_mend(held, gaps)
    assert bool(mend.lines) == (check is not None)
    if check is not None:
        assert check.passed, check
        assert check.outside_mm < 0.02
