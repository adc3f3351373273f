"""Changes of syringe: planned where a stretch fits, and made clear of the ink."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Syringe, load
from gcode.dry_run.run import dry_run
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.syringes import plan_reloads, plunger_travel
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.states import LinkState
from sim.devices.families.marlin_printer import MarlinPrinter
from tests.design.toolpath.plans import embedded_toolpath, fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block, random_tree
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Script, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import (
    PRINTER,
    assert_same_strokes,
)

PLACE = np.array([60.0, 70.0, 20.0])
START_WRITTEN_JOBS = (60.0, 40.0, 60.0)


def fresh() -> Toolpath:
    return fresh_toolpath(as_solid(block(3, 2, 0.24)), FreshOptions())


def embedded() -> Toolpath:
    return embedded_toolpath(random_tree(8, 10, 3, 0.1), EmbeddedOptions())


@pytest.mark.parametrize(("make", "kind"), [(fresh, MarkKind.LAYER), (embedded, MarkKind.VESSEL)])
def test_pause_at_every_mark_leaves_from_above_all_that_is_written(tmp_path, make, kind):
    toolpath = make()
    syringe = load(Syringe, "hamilton_1ml")
    data = write_gcode(
        toolpath, PRINTER, syringe, PLACE, GcodeOptions(start_mm=START_WRITTEN_JOBS)
    ).data
    job = parse_job(data, "part.gcode")
    ends = job.marks.of(kind)
    reloads = job.marks.of(MarkKind.RELOAD)
    assert len(ends) > 2
    assert [mark.index for mark in reloads] == [mark.index for mark in ends[:-1]]
    paused: list[int] = []

    def on_paused(streamer: Streamer) -> None:
        paused.append(streamer.status.lines_done)
        streamer.resume(NewSyringe())

    transport = SimTransport(MarlinPrinter(PRINTER, START_WRITTEN_JOBS), VirtualClock())
    care = Care(checkpoint_s=0.0, reload_at=tuple(mark.index for mark in reloads))
    status = played(data, tmp_path, transport, Script(on_paused=on_paused), care)
    assert status.state is LinkState.DONE, status
    assert paused == list(care.reload_at)

    motion = transport.printer.executed()
    assert_same_strokes(motion, dry_run(data, PRINTER, START_WRITTEN_JOBS).executed)
    across = np.any(motion.start[:, :2] != motion.end[:, :2], axis=1)
    # Parked from above all that was written until then.
    lifts = np.flatnonzero(motion.end[:, 2] >= motion.start[:, 2] + 30)
    assert len(lifts) >= len(paused)
    for lift in lifts:
        before = slice(0, lift)
        writing = (motion.plunger_end > motion.plunger_start)[before] & across[before]
        if writing.any():
            assert motion.start[lift, 2] >= motion.end[before, 2][writing].max()


def test_a_named_syringe_without_a_capacity_is_not_taken_for_the_last_one() -> None:
    for name, capacity_mm in (("small", 0.0), ("", 3.0)):
        with pytest.raises(Refused, match="give its profile and a travel above 0, or neither"):
            NewSyringe(0.0, name, capacity_mm)


@given(
    layers=st.lists(st.floats(0.1, 2.99), min_size=1, max_size=12),
    capacity=st.floats(3.0, 8.0),
    used=st.floats(0.0, 2.9),
)
@settings(deadline=None)
def test_reloads_are_the_fewest_and_each_stretch_fits(layers, capacity, used):
    text, e = ["G92 E0"], 0.0
    for k, push in enumerate(layers):
        e += push
        text += [f"G1 X{k} E{e:.5f}", ";RELOAD", f"G92 E{e - 1:.5f}" if k % 3 == 2 else "M105"]
        e -= k % 3 == 2
    job = parse_job("\n".join(text).encode(), "a")
    travel = plunger_travel(job.lines)
    np.testing.assert_allclose(travel[-1], sum(layers), atol=1e-3)
    total = sum(layers)
    try:
        chosen = plan_reloads(job, capacity, used)
    except LinkError:
        assert layers[0] > capacity - used - 1e-3
        return
    ends = [0, *chosen, len(job)]
    room = [capacity - used, *[capacity] * len(chosen)]
    for begin, end, left in zip(ends, ends[1:], room, strict=False):
        assert travel[end] - travel[begin] <= left + 1e-3
    least = max(0, int(np.ceil((total - capacity + used) / capacity - 1e-6)))
    assert len(chosen) >= least
    if total <= capacity - used - 1e-3:
        assert chosen == ()


def test_stretch_without_a_reload_point_is_named():
    job = parse_job(b"G92 E0\nG1 X1 E3\n;RELOAD\nG1 X2 E9\nG1 X3 E10\n;RELOAD\nG1 X1 E11\n", "a")
    with pytest.raises(LinkError, match=r"lines 4 to 5 of a advance the plunger by 7\.00 mm"):
        plan_reloads(job, 5.0)
    assert plan_reloads(job, 7.0) == (2, 4)
