"""Benchmark of observed prints: fidelity with and without an observer, under faults of the ink.

``python -m benchmarks.observe_prints --prints 10``. Small layered prints of spaced lines, by a
writer of its own, are run through dry run, ink faults and simulated camera; the product's observer
looks by ``--every`` (by default behind each three lines of 7 mm, and each layer) and mends in its
own right (``mend``). Everything but link and pipes is the product's: its marks, journal, pictures,
judgement, decisions and inserts. What lies there in the end is painted and compared by
`checkers.line_dice`, which shares no code with it.

Where a look pauses the print for a clogged needle, the simulated operator clears it and approves.

Clock: none; CPU seconds of a look are told.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from benchmarks.checkers.channel_conductance import channels
from benchmarks.checkers.line_dice import PIXEL_MM, BoolArray, FloatArray, dice, painted
from benchmarks.machine import machine, row
from firmware_profiles import Ink, Printer, Syringe, load
from printctl.machine.link.care import Care
from printctl.machine.link.inserts import Insert
from printctl.machine.link.job import Job, load_job
from printctl.machine.link.journal import Journal
from printctl.machine.link.record import JOURNAL
from printctl.machine.link.watch import DueTask, Watch
from printctl.observe.deciding import Decider, FlowControl, Limits
from printctl.observe.devices import DeviceSettings
from printctl.observe.look_values import Look
from printctl.observe.looking_at import ObservedJob
from printctl.observe.observer import Observer
from printctl.observe.order import ObserverOrder
from printctl.observe.records import answer_look, look_folder, read_looks
from printctl.observe.view_before import EMPTY
from printctl.pipeline.observing import look_care
from printctl.recipe.observe import ObservePart
from sim.devices.camera.paint import load_camera, paint
from sim.gcode.deposit.ink_faults import Bubble, Clog, Drift, InkFault, InkFaults, Lost
from sim.gcode.deposit.lay import Laid, laid, nothing_laid
from sim.gcode.deposit.written import written
from sim.gcode.dry_run.run import dry_run

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

    kinds = {
        "clog": lambda: Clog(
            fault="clog",
            written_mm=where(),
            lasts_mm=float(rng.uniform(2, 25)) if rng.random() < 0.5 else None,
        ),
        "drift": lambda: Drift(
            fault="drift", written_mm=where() / 3, factor=float(rng.choice([0.7, 1.3]))
        ),
        "lost": lambda: Lost(fault="lost", written_mm=where(), strokes=int(rng.integers(1, 4))),
        "bubble": lambda: Bubble(
            fault="bubble", pushed_ul=where() * 0.0225, ul=rng.uniform(0.02, 0.2)
        ),
    }
    chosen = rng.choice(list(kinds), size=int(rng.integers(1, 4)), replace=False)
    return InkFaults(tuple(kinds[str(one)]() for one in chosen), int(rng.integers(1 << 30)))


def camera_file(folder: Path, rng: np.random.Generator) -> Path:
    """Write a camera over the print: 12 to 18 µm a pixel, tilted, any dye, any light."""
    middle = CORNER + SIZE_MM / 2
    dark = bool(rng.integers(2))
    colour = rng.uniform(30, 110, 3) if dark else rng.uniform(215, 250, 3)
    bath = rng.uniform(150, 190, 3) if dark else rng.uniform(70, 120, 3)
    said = {
        "camera": {
            "size_px": [800, 800],
            "um_per_px": float(rng.uniform(12, 14)),
            "target_mm": [*middle.tolist(), Z0 + LAYERS * LAYER_MM],
            "tilt_deg": float(rng.uniform(0, 15)),
            "tilt_towards_deg": float(rng.uniform(0, 360)),
            "turn_deg": float(rng.uniform(-20, 20)),
            "distortion": [float(rng.uniform(-0.1, 0.1)), 0.0, 0.0005, -0.0004, 0.0],
        },
        "scene": {
            "bath": {"colour": bath.tolist(), "texture": float(rng.uniform(0.01, 0.05))},
            "ink": {"colour": colour.tolist(), "density_per_mm": float(rng.uniform(8, 20))},
            "light": {
                "azimuth_deg": float(rng.uniform(0, 360)),
                "uneven": float(rng.uniform(0, 0.4)),
            },
        },
        "laid": {"printer": PRINTER, "syringe": SYRINGE, "ink": INK, "style": "layered"},
    }
    path = folder / "camera.yaml"
    path.write_text(yaml.safe_dump(said))
    return path


@dataclass
class World:
    """A print on a simulated machine whose ink has faults; stands for link and printer.

    Attributes
    ----------
    folder : Path
    job : Job
        As it has grown.
    faults : InkFaults
    """

    folder: Path
    job: Job
    faults: InkFaults
    done: int = 0
    watch: Watch | None = None
    looks: int = 0
    decisions: list[str] = field(default_factory=list)
    decided: int = 0
    """The look that was decided last."""
    pictures: int = 0

    def lies(self, done: int | None = None, faults: InkFaults | None = None) -> Laid:
        """Ink that lies there after so many lines of the grown job."""
        printer = load(Printer, PRINTER)
        text = b"\n".join(self.job.lines[:done]) + b"\n"
        syringe, ink = load(Syringe, SYRINGE), load(Ink, INK)
        executed = dry_run(text, printer, (0.0, 0.0, 0.0), cold_extrusion=True).executed
        return laid(
            executed,
            self.faults if faults is None else faults,
            syringe.area_mm2 * ink.flow_factor,
            style="layered",
            plunger_step_mm=1 / printer.steps_per_mm.e,
            layer_mm=LAYER_MM,
        )

    # --- what the observer asks of a link ------------------------------------------------------

    def insert(
        self,
        look: int,
        lines: Sequence[str],
        why: str,
        flow: float | None = None,
        again: bool = False,
    ) -> None:
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
                self.watch.look_behind(self.done + len(lines))

    def look_done(self, look: int, decision: str, why: str, again: bool = False) -> None:
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
        printer, syringe, ink = load(Printer, PRINTER), load(Syringe, SYRINGE), load(Ink, INK)
        text = b"\n".join(self.job.lines[: self.done]) + b"\n"
        executed = dry_run(text, printer, (0.0, 0.0, 0.0), cold_extrusion=True).executed
        # As faults count it: what is written twice lies once, and counts twice.
        lines = written(executed, syringe.area_mm2 * ink.flow_factor).lines
        so_far = float(np.linalg.norm(lines.end - lines.start, axis=1).sum())
        self.faults = replace(
            self.faults, each=tuple(_cleared(one, so_far) for one in self.faults.each)
        )

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
    seen = load_camera(camera)
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
    acquire(Look(EMPTY, 0, 0, 0, "begin"), look_folder(folder, EMPTY) / "picture")
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
    return float(
        np.average([dice(*pair) for pair in pairs], weights=[pair[1].sum() for pair in pairs])
    )


def lumens(ink: Laid) -> FloatArray:
    """Conductance of the channel between each two neighbouring lines, in all layers."""
    found = []
    begin = round((1.0 + WIDTH_MM) / PIXEL_MM)
    columns = slice(begin, begin + round((SIZE_MM - 2 * WIDTH_MM) / PIXEL_MM))
    for layer, picture in enumerate(_pictures(ink)):
        lines = 1.0 + np.array(places(layer))
        rows = np.round((lines[:-1] + lines[1:]) / 2 / PIXEL_MM).astype(int)
        seen = picture.T if layer % 2 else picture
        found.append(channels(seen, rows.tolist(), columns, LAYER_MM, PIXEL_MM))
    return np.concatenate(found)


def _near(ratios: list[FloatArray]) -> float:
    """Lumens whose conductance is within 10 % of the design's, %."""
    return round(100 * float(np.mean(np.abs(np.concatenate(ratios) - 1) <= 0.1)), 1)


def _whole(ratios: list[FloatArray]) -> float:
    """Prints of which the mean conductance is within 10 % of the design's, %."""
    return round(100 * float(np.mean([abs(one.mean() - 1) <= 0.1 for one in ratios])), 1)


def main() -> None:
    """Run and print JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--prints", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--every", default=EVERY)
    parser.add_argument("--verbose", action="store_true")
    said = parser.parse_args()
    rng = np.random.default_rng(said.seed)
    free_without, free_with = list[FloatArray](), list[FloatArray]()
    without, with_it, seconds, sound_wrong, sound_looks = [], [], [], 0, 0
    for k in range(said.prints):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            path = folder / "job.gcode"
            path.write_bytes(job_text())
            faults = random_faults(rng) if k % 5 else InkFaults()
            camera = camera_file(folder, rng)
            plain = World(folder, load_job(path, load(Printer, PRINTER)), faults)
            design = plain.lies(faults=InkFaults())
            begun = time.process_time()
            world = observed(folder, faults, camera, path, said.every)
            seconds.append((time.process_time() - begun) / world.looks)
            pair = fidelity(plain.lies(), design), fidelity(world.lies(), design)
            if faults.each:
                without.append(pair[0])
                with_it.append(pair[1])
                open_mm = lumens(design)
                free_without.append(lumens(plain.lies()) / open_mm)
                free_with.append(lumens(world.lies()) / open_mm)
            else:
                sound_looks += world.looks
                sound_wrong += len(world.job.inserts) + sum(
                    not one.startswith("go_on") for one in world.decisions
                )
            if said.verbose:
                kinds = [type(one).__name__ for one in faults.each]
                print(f"{k}: {pair[0]:.3f} -> {pair[1]:.3f}", kinds)
                print("   ", "\n    ".join(world.decisions), flush=True)
    faulty = np.array(without) < 0.97
    rows: list[dict[str, Any]] = [
        row("Dice of lines without observer, mean", round(float(np.mean(without)), 4), "",
            "<= 0.85"),
        row("Dice of lines with it, mean", round(float(np.mean(with_it)), 4), "", ">= 0.98",
            float(np.mean(with_it)) >= 0.98),
        row("least with it", round(float(np.min(with_it)), 4), ""),
        row("lumens within 10 % of design's conductance, without", _near(free_without), "%"),
        row("with it", _near(free_with), "%", "100", _near(free_with) == 100),
        row("prints whose lumens together are, without", _whole(free_without), "%"),
        row("with it", _whole(free_with), "%", "100", _whole(free_with) == 100),
        row("prints below 0.97 without it", int(faulty.sum()), f"of {len(without)}"),
        row("decisions but go_on in sound prints", sound_wrong,
            f"of {sound_looks} looks", "0", sound_wrong == 0),
        row("CPU s per look, painting included", round(float(np.median(seconds)), 2), "s"),
    ]  # fmt: skip
    print(json.dumps({"machine": machine(), "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
