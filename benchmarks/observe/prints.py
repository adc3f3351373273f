"""Benchmark of observed prints: fidelity with and without an observer, under faults of the ink.

Small layered prints of spaced lines, by a writer of its own, are run through dry run, ink faults
and simulated camera; the product's observer looks behind each three lines of 7 mm, and each layer,
and mends in its own right (``mend``). Everything but link and pipes is the product's: its marks,
journal, pictures, judgement, decisions and inserts. What lies there in the end is painted and
compared by `checkers.line_dice`, which shares no code with it. Where a look pauses the print for a
clogged needle, the simulated operator clears it and approves.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import yaml

from benchmarks.checkers.line_dice import BoolArray, dice, painted
from benchmarks.common import Row, at_least, limited, row, scratch
from firmware_profiles import Ink, Printer, Syringe, load
from gcode.deposit.ink_faults import Bubble, Clog, Drift, InkFault, InkFaults, Lost
from gcode.deposit.lay import Laid, laid, nothing_laid
from gcode.deposit.written import written
from gcode.dry_run.run import dry_run
from gcode.motion.executed import ExecutedMotion
from printctl.machine.control.watch import DueTask, Watch
from printctl.machine.job.care import Care
from printctl.machine.job.job import Insert, Job, load_job
from printctl.machine.records.journal import Journal
from printctl.machine.records.record import JOURNAL
from printctl.observe.deciding import Decider, FlowControl, Limits
from printctl.observe.devices import DeviceSettings
from printctl.observe.looks.look_context import Look
from printctl.observe.looks.views import EMPTY_LOOK_NUMBER
from printctl.observe.observed_job import ObservedJob
from printctl.observe.observer import Observer
from printctl.observe.order import ObserverOrder
from printctl.observe.records import answer_look, look_folder, read_looks
from printctl.pipeline.observing import look_care
from printctl.recipe.sections.observe import ObservePart
from sim.devices.camera.paint import CameraFile, paint

PRINTER, SYRINGE, INK, NEEDLE = "generic_marlin", "hamilton_1ml", "collagen_fresh", "fresh_150um"
SIZE_MM, PITCH_MM, WIDTH_MM, LAYER_MM, LAYERS = 7.0, 0.7, 0.25, 0.1, 4
EVERY = "20 mm written"
CORNER = np.array([100.0, 100.0])
Z0 = 1.0


def places(layer: int) -> list[float]:
    """Where a layer's lines lie, across them, mm; none lies along the one below it."""
    aside = PITCH_MM / 2 * (layer // 2 % 2)
    return list(np.arange(aside, SIZE_MM + 1e-9, PITCH_MM))


def job_text(speed_mm_s: float = 20.0) -> bytes:
    """G-code of layers of spaced lines, each a stroke; every other layer across."""
    syringe, ink = load(Syringe, SYRINGE), load(Ink, INK)
    area = (WIDTH_MM - LAYER_MM) * LAYER_MM + np.pi / 4 * LAYER_MM**2
    per_mm = area / (syringe.area_mm2 * ink.flow_factor)
    relief = ink.retract_ul / (syringe.area_mm2 * ink.flow_factor)
    lines = ["G21", "G90", "M82", "G92 E0", f"G0 Z{Z0 + 2:.2f} F300"]
    e = 0.0
    for layer in range(LAYERS):
        z = Z0 + layer * LAYER_MM
        for k, off in enumerate(places(layer)):
            a, b = np.array([0.0, off]), np.array([SIZE_MM, off])
            if layer % 2:
                a, b = a[::-1], b[::-1]
            if k % 2:
                a, b = b, a
            (ax, ay), (bx, by) = a + CORNER, b + CORNER
            lines += [f"G0 X{ax:.3f} Y{ay:.3f} F2400", f"G0 Z{z:.3f} F300"]
            lines.append(f"G1 E{e:.5f} F2")
            e += SIZE_MM * per_mm
            lines.append(f"G1 X{bx:.3f} Y{by:.3f} E{e:.5f} F{60 * speed_mm_s:g}")
            lines += [f"G1 E{e - relief:.5f} F2", f"G0 Z{z + 0.5:.3f} F300"]
        lines.append(f";LAYER_END:{layer}")
    lines += [f"G0 Z{Z0 + 5:.2f} F300", "G0 X110 Y110 F2400"]
    return ("\n".join(lines) + "\n").encode()


def random_faults(rng: np.random.Generator) -> InkFaults:
    """Return one to three faults: clogs, drift of ± 30 %, lost lines, bubbles.

    Half of the clogs pass by themselves, the others stay until somebody clears the needle.
    """
    way = SIZE_MM * (SIZE_MM / PITCH_MM + 1) * LAYERS

    def where() -> float:
        return float(rng.uniform(0, 0.95 * way))

    def made(kind: str) -> InkFault:
        if kind == "clog":
            at, lasts = where(), float(rng.uniform(2, 25)) if rng.random() < 0.5 else None
            return Clog(fault="clog", written_mm=at, lasts_mm=lasts)
        if kind == "drift":
            at, factor = where() / 3, float(rng.choice([0.7, 1.3]))
            return Drift(fault="drift", written_mm=at, factor=factor)
        if kind == "lost":
            return Lost(fault="lost", written_mm=where(), strokes=int(rng.integers(1, 4)))
        return Bubble(fault="bubble", pushed_ul=where() * 0.0225, ul=rng.uniform(0.02, 0.2))

    kinds = ["clog", "drift", "lost", "bubble"]
    chosen = rng.choice(kinds, size=int(rng.integers(1, 4)), replace=False)
    return InkFaults(tuple(made(str(one)) for one in chosen), int(rng.integers(1 << 30)))


def camera_file(folder: Path, rng: np.random.Generator) -> Path:
    """Write a camera over the print: 12 to 18 µm a pixel, tilted, any dye, any light."""
    middle = CORNER + SIZE_MM / 2
    dark = bool(rng.integers(2))
    colour = rng.uniform(30, 110, 3) if dark else rng.uniform(215, 250, 3)
    bath = rng.uniform(150, 190, 3) if dark else rng.uniform(70, 120, 3)
    settings = {
        "camera": {
            "size_px": [800, 800],
            "um_per_px": rng.uniform(12, 14),
            "target_mm": [*middle.tolist(), Z0 + LAYERS * LAYER_MM],
            "tilt_deg": rng.uniform(0, 15),
            "tilt_towards_deg": rng.uniform(0, 360),
            "turn_deg": rng.uniform(-20, 20),
            "distortion": [rng.uniform(-0.1, 0.1), 0.0, 0.0005, -0.0004, 0.0],
        },
        "scene": {
            "bath": {"colour": bath.tolist(), "texture": rng.uniform(0.01, 0.05)},
            "ink": {"colour": colour.tolist(), "density_per_mm": rng.uniform(8, 20)},
            "light": {"azimuth_deg": rng.uniform(0, 360), "uneven": rng.uniform(0, 0.4)},
        },
        "laid": {"printer": PRINTER, "syringe": SYRINGE, "ink": INK, "style": "layered"},
    }
    path = folder / "camera.yaml"
    path.write_text(yaml.safe_dump(settings))
    return path


@dataclass
class World:
    """A print on a simulated machine whose ink has faults; stands for link and printer.

    ``job`` is as it has grown, ``decided`` the look that was decided last.
    """

    folder: Path
    job: Job
    faults: InkFaults
    done: int = 0
    watch: Watch | None = None
    looks: int = 0
    decisions: list[str] = field(default_factory=list)
    decided: int = 0
    pictures: int = 0

    def executed(self, done: int | None) -> tuple[ExecutedMotion, float]:
        """Return the motion of so many lines of the grown job, and the volume per mm of E."""
        syringe, ink = load(Syringe, SYRINGE), load(Ink, INK)
        text = b"\n".join(self.job.lines[:done]) + b"\n"
        run = dry_run(text, load(Printer, PRINTER), (0.0, 0.0, 0.0), cold_extrusion=True)
        return run.executed, syringe.area_mm2 * ink.flow_factor

    def lies(self, done: int | None = None, faults: InkFaults | None = None) -> Laid:
        """Return the ink that lies there after so many lines of the grown job."""
        step, (executed, per_e) = 1 / load(Printer, PRINTER).steps_per_mm.e, self.executed(done)
        faults = self.faults if faults is None else faults
        return laid(
            executed, faults, per_e, style="layered", plunger_step_mm=step, layer_mm=LAYER_MM
        )

    # --- what the observer asks of a link ------------------------------------------------------

    def insert(
        self, look: int, lines: Sequence[str], why: str, flow: float | None = None,
        again: bool = False,
    ) -> None:  # fmt: skip
        """Let the job grow, and journal it."""
        wanted = self.job.flow if flow is None else flow
        insert = Insert(look, self.done, tuple(line.encode() for line in lines), why, wanted)
        journal = Journal(self.folder / JOURNAL)
        journal.add("insert", **insert.to_record(), reload_at=[], reload_heads=[])
        journal.close()
        self.job = self.job.grown(insert)
        if self.watch is not None:
            self.watch.grow(self.job.marks, self.done, len(lines))
            if again:
                self.watch.insert_end = self.done + len(lines)

    def decide(self, look: int, decision: str, why: str, again: bool = False) -> None:
        """Note the decision; the operator clears a clogged needle and approves what is asked."""
        self.decisions.append(f"{decision}: {why}")
        self.decided = look
        asked = read_looks(self.folder)[-1].asked
        if asked or "the needle is clogged" in why:
            self.clear_needle()
        if asked:
            answer_look(self.folder, look, "approve")

    def clear_needle(self) -> None:
        """End clogs that have begun: the operator's part of an approved pause."""
        # As faults count it: what is written twice lies once, and counts twice.
        lines = written(*self.executed(self.done)).lines
        so_far = float(np.linalg.norm(lines.end - lines.start, axis=1).sum())
        each = tuple(_cleared(one, so_far) for one in self.faults.each)
        self.faults = replace(self.faults, each=each)

    def resume(self) -> None:
        """Go on: nobody pauses here."""

    def stop(self) -> None:
        """End: nobody stops here."""


def _cleared(fault: InkFault, written_mm: float) -> InkFault:
    """Return a fault as it is once the needle was cleared behind so much written way."""
    if not isinstance(fault, Clog) or not (fault.written_mm or 0.0) < written_mm:
        return fault
    lasted = written_mm - (fault.written_mm or 0.0)
    return fault.model_copy(update={"lasts_mm": min(fault.lasts_mm or lasted, lasted)})


def observed(folder: Path, faults: InkFaults, camera: Path, path: Path, every: str) -> World:
    """Print with an observer that looks where the link would hold the print."""
    world = World(folder, load_job(path, load(Printer, PRINTER)), faults)
    Journal(folder / JOURNAL).close()
    seen = CameraFile.load(camera)
    order = ObserverOrder(
        job=str(path), profile=PRINTER, syringe=SYRINGE, ink=INK, needle=NEEDLE,
        embedded=False, oct=False,
        frame="", device=DeviceSettings("simulated", extra={"camera": str(camera)}),
        limits=Limits(mend="mend"),
    )  # fmt: skip
    job = ObservedJob(folder, order)

    def acquire(look: Look, out: Path) -> Path:
        ink = world.lies(world.done) if look.number else nothing_laid()
        world.pictures += 1
        picture = paint(ink, seen.camera, seen.scene, world.pictures)
        cv2.imwrite(str(out.with_suffix(".png")), picture)
        return out.with_suffix(".png")

    before = 0
    acquire(
        Look(EMPTY_LOOK_NUMBER, 0, 0, 0, "begin"),
        look_folder(folder, EMPTY_LOOK_NUMBER) / "picture",
    )
    job.begun = time.time()
    decider = Decider(order.limits, FlowControl(order.limits.flow))
    observer = Observer(
        folder, world, acquire, job.judge, job.mend_lines, decider,
        lambda number: world.decided >= number,
    )  # fmt: skip
    part = ObservePart(device="camera", every=every)
    watch = Watch(world.job.marks, Care(None, **look_care(part, embedded=False)), world.job.lines)
    world.watch, number = watch, 0
    while (stop := watch.next_stop(0.0, world.done, True, len(world.job))) < len(world.job):
        world.done = stop
        if watch.due(0.0, stop) is DueTask.LOOK:
            number += 1
            observer.look(Look(number, stop, stop, before, f"line {stop}"))
            watch.looked(0.0, stop)
            before = stop
    world.looks = number
    return world


def _pictures(ink: Laid) -> list[BoolArray]:
    """Each layer's lines from above."""
    low, high = CORNER - 1.0, CORNER + SIZE_MM + 1.0
    box, lines, found = (low[0], low[1], high[0], high[1]), ink.strands, []
    for layer in range(LAYERS):
        own = np.abs(lines.end[:, 2] - Z0 - layer * LAYER_MM) < LAYER_MM / 2
        width = lines.area_mm2[own] / LAYER_MM + (1 - np.pi / 4) * LAYER_MM
        width = np.where(lines.area_mm2[own] > 1e-5, width, 0.0)
        found.append(painted(lines.start[own, :2], lines.end[own, :2], width, box))
    return found


def fidelity(real: Laid, design: Laid) -> float:
    """Dice of lines over all layers."""
    pairs = list(zip(_pictures(real), _pictures(design), strict=True))
    weights = [pair[1].sum() for pair in pairs]
    return float(np.average([dice(*pair) for pair in pairs], weights=weights))


def rows(quick: bool) -> Iterator[Row]:
    """Yield prints with and without an observer, each fifth of them sound."""
    rng = np.random.default_rng(1)
    pairs, seconds, wrong, looks = list[tuple[float, float]](), list[float](), 0, 0
    for k in (1,) if quick else range(30):
        with scratch() as folder:
            path = folder / "job.gcode"
            path.write_bytes(job_text())
            faults = random_faults(rng) if k % 5 else InkFaults()
            camera = camera_file(folder, rng)
            plain = World(folder, load_job(path, load(Printer, PRINTER)), faults)
            design = plain.lies(faults=InkFaults())
            begun = time.process_time()
            every = "layer" if quick else EVERY
            world = observed(folder, faults, camera, path, every)
            seconds.append((time.process_time() - begun) / world.looks)
            if faults.each:
                pairs.append((fidelity(plain.lies(), design), fidelity(world.lies(), design)))
            else:
                acts = [one for one in world.decisions if not one.startswith("go_on")]
                wrong, looks = wrong + len(world.job.inserts) + len(acts), looks + world.looks
    without, with_it = np.array(pairs).T
    mean, least = float(with_it.mean()), {"least": float(with_it.min())}
    yield row(f"{len(pairs)} faulty prints, Dice of lines without observer", without.mean())
    yield at_least("the same with it, mean", mean, "", 0.98) | least
    yield limited("decisions but go_on in sound prints", wrong, f"of {looks} looks", 0)
    yield row("a look, painting included", float(np.median(seconds)), "CPU s")
