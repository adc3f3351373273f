"""Jobs of our own writer: held at their marks with the needle clear of ink."""

from __future__ import annotations

import numpy as np
import pytest

from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Syringe, load
from printctl.machine.link.care import Care, NewSyringe
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.states import LinkState
from printctl.machine.link.streamer import Streamer
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.dry_run.run import dry_run
from tests.design.toolpath.plans import embedded_toolpath, fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block, random_tree
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import PRINTER, Script, played
from tests.printctl.machine.link.sim_transport import SimTransport

PLACE = np.array([60.0, 70.0, 20.0])
START = (60.0, 40.0, 60.0)


def fresh() -> Toolpath:
    return fresh_toolpath(as_solid(block(3, 2, 0.24)), FreshOptions())


def embedded() -> Toolpath:
    return embedded_toolpath(random_tree(8, 10, 3, 0.1), EmbeddedOptions())


@pytest.mark.parametrize(("make", "kind"), [(fresh, MarkKind.LAYER), (embedded, MarkKind.VESSEL)])
def test_pause_at_every_mark_leaves_from_above_all_that_is_written(tmp_path, make, kind):
    toolpath = make()
    syringe = load(Syringe, "hamilton_1ml")
    data = write_gcode(toolpath, PRINTER, syringe, PLACE, GcodeOptions(start_mm=START)).data
    job = parse_job(data, "part.gcode")
    ends = job.marks.of(kind)
    reloads = job.marks.of(MarkKind.RELOAD)
    assert len(ends) > 2
    assert [mark.index for mark in reloads] == [mark.index for mark in ends[:-1]]
    paused: list[int] = []

    def on_paused(streamer: Streamer) -> None:
        paused.append(streamer.status.lines_done)
        streamer.resume(NewSyringe())

    transport = SimTransport(MarlinPrinter(PRINTER, START), VirtualClock())
    care = Care(checkpoint_s=0.0, reload_at=tuple(mark.index for mark in reloads))
    status = played(data, tmp_path, transport, Script(on_paused=on_paused), care)
    assert status.state is LinkState.DONE, status
    assert paused == list(care.reload_at)

    motion = transport.printer.executed()
    foreseen = dry_run(data, PRINTER, START).executed
    across = np.any(motion.start[:, :2] != motion.end[:, :2], axis=1)
    expected = np.any(foreseen.start[:, :2] != foreseen.end[:, :2], axis=1)
    np.testing.assert_array_equal(motion.end[across], foreseen.end[expected])
    pushed = (motion.plunger_end - motion.plunger_start)[across]
    wanted = (foreseen.plunger_end - foreseen.plunger_start)[expected]
    np.testing.assert_allclose(pushed, wanted, atol=1e-9)
    # Parked from above all that was written until then.
    lifts = np.flatnonzero(motion.end[:, 2] >= motion.start[:, 2] + 30)
    assert len(lifts) >= len(paused)
    for lift in lifts:
        before = slice(0, lift)
        writing = (motion.plunger_end > motion.plunger_start)[before] & across[before]
        if writing.any():
            assert motion.start[lift, 2] >= motion.end[before, 2][writing].max()
