"""Random gaps in random strokes: checks hold, and the deposited ink closes the gap."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_profiles.materials import MeasuredLag
from printctl.observe.mending import Gap, check_mend, checked_mend, plan_mend, written_paths
from sim.gcode.deposit.lay import deposit
from sim.gcode.dry_run.run import dry_run
from tests.printctl.observe.mending.small_jobs import (
    LAYER_MM,
    NEEDLE,
    SYRINGE,
    bath_job,
    layered_job,
)

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
        gaps.append(Gap(path.number, low, low + length, 0.4 if thin else 1.0, 0.1))
    mend, check = checked_mend(held, gaps)
    assert bool(mend.lines) == (check is not None)
    if check is not None:
        assert check.passed, check
        assert check.outside_mm < 0.02
