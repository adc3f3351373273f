"""Benchmark of a laser line with a camera: heights, false gaps, gaps found, time of a look.

``python -m benchmarks.observe_sweep --layers 4``. Pictures by `checkers.laser_painter`: an insert
around a dish of 35 mm, a camera 25 degrees aslant from one side, a laser 15 degrees from the other,
that turns or moves and isn't ideal; the layers of `checkers.profiler_painter` lie in the dish. The
frame is fitted to a painted picture, its lens known. Clock: wall and CPU, of reading and judging.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import tifffile

from benchmarks.checkers.dish_camera import Made, Optics, Scene, aimed, photograph
from benchmarks.checkers.laser_painter import Heights, Look, Swept, laser_over, looked_at
from benchmarks.checkers.profiler_painter import Bare, Kind, Profiled, profiled
from benchmarks.machine import machine, row
from benchmarks.observe_laser import expected
from firmware_profiles import load
from firmware_profiles.plates import Dish
from registration.devices.camera_frame import (
    CameraFrame,
    Ties,
    Touch,
    check_frame,
    design_insert,
    find_marks,
    fit_frame,
)
from registration.devices.laser_sweep import FittedSweep, fit_laser, sweep_heights, trace
from registration.devices.lens import Lens
from registration.files.readers.heights import HeightMap
from registration.inspection import LayerFindings, see_layer, surface_of

KINDS: tuple[Kind, ...] = ("plate", "solid")
LENGTHS_MM = (0.3, 0.5, 1.0)
SIZE = (1640, 1232)
FLOOR_Z = 1.5
_SIDE_MM = 5.0
_BIG_MM = 20.0
_MAP_Z = 3.0
"""Of the plate in a painted map."""
_LEAST_WIDTH_MM = 0.35
_SPACING_MM = 0.05
_QUALITY = 95
_NOW = datetime(2026, 11, 27, tzinfo=UTC)


@dataclass
class Rig:
    """A camera, its insert, a laser, and what the product knows of them."""

    optics: Optics
    made: Made
    scene: Scene
    laser: Swept
    turns: bool
    frame: CameraFrame
    seed: int

    def amounts(self, wide_mm: float, spacing_mm: float) -> np.ndarray:
        """Turns, rad, or moves, mm, that cover a width in the dish's middle, shaken a little."""
        rng = np.random.default_rng((self.seed, 3))
        way = np.arange(-wide_mm / 2, wide_mm / 2, spacing_mm)
        way = rng.permutation(way + rng.normal(0, 0.15 * spacing_mm, len(way)))
        return -np.arctan(way / 200.0) if self.turns else way


def rig(seed: int) -> Rig:
    """A random rig over a dish of 35 mm."""
    rng = np.random.default_rng((seed, 1))
    insert = design_insert(load(Dish, "petri_35mm"), process="engraved", mark_mm=7.0)
    target = np.array([*rng.uniform(80, 120, 2), FLOOR_Z + rng.uniform(1.5, 3.0)])
    azimuth = rng.uniform(0, 6.28)
    focal, away = 3300.0, 3300.0 * max(insert.plate_mm) * 1.2 / SIZE[1]
    rotation, centre = aimed(target, away, np.radians(25), azimuth, azimuth + np.pi / 2)
    k = (rng.uniform(-0.3, 0.1), rng.uniform(-0.2, 0.2))
    axis = tuple((np.array(SIZE) - 1) / 2 + rng.normal(0, 15, 2))
    optics = Optics(SIZE, focal, axis, k, (3e-4, -2e-4), rotation, centre)
    off = rng.normal(0, 0.01, (len(insert.marks), 2))
    made = Made(insert.model_dump(mode="json"), off, 1.0002, 0.01, np.eye(3), target)
    scene = Scene(blur=1.0, read=2.0, quality=_QUALITY, white=110, black=18, gamma=0.9)
    turns = bool(seed % 2)
    laser = laser_over(target, azimuth + np.pi, np.radians(15), 200.0, turns, askew=1.0)
    sure = np.diag(np.array([1.5, 1.5, 1.5, 2e-3, 1e-2, 2e-5, 2e-5, 1e-3]) ** 2)
    lens = Lens(
        size_px=SIZE, focal_px=focal, centre_px=axis, distortion=(*k, 3e-4, -2e-4, 0.0),
        um_per_px=48.0, um_per_px_95=(47.9, 48.1), off_px=0.05,
        covariance=tuple(tuple(map(float, row)) for row in sure),
    )  # fmt: skip
    marks = find_marks(photograph(optics, made, scene, seed), insert, lens, "seen")
    there = made.world(np.array([[c.x_mm, c.y_mm] for c in insert.crosses]))
    there += rng.normal(0, 0.015, there.shape)
    touches = [
        Touch(c.name, *place, u_mm=0.015) for c, place in zip(insert.crosses, there, strict=True)
    ]
    frame = fit_frame(marks, insert, lens, Ties(touches=touches), _NOW)
    return Rig(optics, made, scene, laser, turns, frame, seed)


def painted(rig: Rig, look: Look, amounts: np.ndarray) -> Iterator[np.ndarray]:
    """Pictures of a sweep, in any order."""
    for number, amount in enumerate(amounts):
        yield look.picture(rig.laser.sheet(float(amount)), 1000 * rig.seed + number)


def write(pictures: Iterator[np.ndarray], folder: Path) -> Path:
    """Write a sweep's pictures as JPEGs into an emptied folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for number, one in enumerate(pictures):
        quality = [cv2.IMWRITE_JPEG_QUALITY, _QUALITY]
        cv2.imwrite(str(folder / f"{number:04d}.jpg"), one, quality)
    return folder


def fitted(rig: Rig, folder: Path) -> FittedSweep:
    """The product's fit to a sweep over the dish's floor."""
    look = looked_at(rig.optics, rig.made, rig.scene, rig.laser, FLOOR_Z, seed=rig.seed)
    path = write(painted(rig, look, rig.amounts(30.0, 0.8)), folder / "flat")
    return fit_laser(trace(path, rig.frame), rig.frame, FLOOR_Z, _NOW)


def laid(rig: Rig, map_: Profiled) -> tuple[Heights, Profiled]:
    """A painted layer in the dish's middle, and its lines there."""
    low = rig.made.origin[:2] - np.array(map_.surface.shape[::-1]) * map_.px / 2
    to_dish = np.array([*low, FLOOR_Z - _MAP_Z])
    start, end = (
        one @ map_.to_map[:3, :3].T + map_.to_map[:3, 3] + to_dish for one in (map_.start, map_.end)
    )
    return Heights(map_.surface, low, map_.px), replace(map_, start=start, end=end)


def swept(rig: Rig, map_: Profiled, folder: Path, wide_mm: float) -> tuple[Path, Profiled, Heights]:
    """Write the pictures of a layer's sweep."""
    ink, there = laid(rig, map_)
    look = looked_at(rig.optics, rig.made, rig.scene, rig.laser, FLOOR_Z, ink, rig.seed)
    path = write(painted(rig, look, rig.amounts(wide_mm, _SPACING_MM)), folder / "look")
    return path, there, ink


def judged(path: Path, found: FittedSweep, map_: Profiled) -> tuple[LayerFindings, HeightMap]:
    """Judge a sweep as an observer does."""
    laser = found.laser
    traced = trace(path, laser.frame)
    held = check_frame(traced.ground, laser.frame)
    if not held.holds:
        raise SystemExit(f"the frame doesn't hold: {held.why}")
    lines = expected(map_)
    places = np.concatenate([lines.start, lines.end])[:, :2]
    heights = sweep_heights(traced, laser, places.min(axis=0) - 2, places.max(axis=0) + 2)
    surface = surface_of(heights, np.eye(4), map_.middle_z, map_.thickness, lines)
    findings = see_layer(
        surface.picture, surface.frame, lines, hidden=surface.hidden, thickness_mm=map_.thickness
    )
    return findings, heights


def off_um(heights: HeightMap, ink: Heights) -> np.ndarray:
    """How far heights are off the truth where that is level, lines' crests and plate, µm."""
    rows, columns = heights.height_mm.shape
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    at = np.column_stack([x.ravel(), y.ravel()]) * heights.pixel_mm + heights.origin_mm
    true, step = ink.at(at), 0.06
    moved = [ink.at(at + d) for d in ([step, 0], [-step, 0], [0, step], [0, -step])]
    level = np.ptp(np.array([true, *moved]), axis=0) < 0.02
    off = 1e3 * (heights.height_mm.ravel() - FLOOR_Z - true)
    return off[level & np.isfinite(off)]


def layer(seed: int, kind: Kind, bare: tuple[Bare, ...] = ()) -> Profiled:
    """A layer with lines of 0.35 mm and more."""
    for number in range(100 * seed, 100 * seed + 100):
        map_ = profiled(number, kind, bare, size=_SIDE_MM, px=0.015)
        if map_.width >= _LEAST_WIDTH_MM:
            return map_
    raise SystemExit("no seed has wide lines")


def with_gap(seed: int, kind: Kind, length: float) -> tuple[Profiled, int, Bare]:
    """A layer with a gap in its middle, the gap's stroke, and where it is along that."""
    plain = layer(seed, kind)
    top = np.flatnonzero(plain.layer == plain.layer.max())
    line = int(np.random.default_rng((seed, 6)).integers(1, len(top) - 1))
    begin = 0.45 * _SIDE_MM
    map_ = layer(seed, kind, ((line, begin, begin + length),))
    if line % 2:  # it is written back
        begin = _SIDE_MM - begin - length
    return map_, int(top[line]), (line, begin, begin + length)


def kind_rows(kind: Kind, layers: int, folder: Path) -> list[dict[str, object]]:
    """Rows on sound layers and on ones with a gap."""
    false, seen, gaps, off = 0, list[float](), dict[float, list[bool]](), list[np.ndarray]()
    told, beside = list[float](), 0
    for seed in range(layers):
        own = rig(seed)
        found = fitted(own, folder)
        told.append(found.laser.off_um)
        wide = _SIDE_MM * 1.42 + 1.5
        path, map_, ink = swept(own, layer(seed, kind), folder, wide)
        findings, heights = judged(path, found, map_)
        off.append(off_um(heights, ink))
        false += bool(findings.gaps)
        seen.append(findings.seen_share)
        for length in LENGTHS_MM:
            map_, stroke, bare = with_gap(seed + layers, kind, length)
            path, map_, _ = swept(own, map_, folder, wide)
            findings, _ = judged(path, found, map_)
            hits = [
                one.stroke == stroke and one.from_mm < bare[2] and one.to_mm > bare[1]
                for one in findings.gaps
            ]
            s = findings.stations
            own_stations = np.flatnonzero(s.stroke == stroke)
            middle = own_stations[np.abs(s.along_mm[own_stations] - sum(bare[1:]) / 2).argmin()]
            if any(hits) or s.seen[middle]:
                gaps.setdefault(length, []).append(any(hits))
            beside += len(hits) - sum(hits)
    biases = [abs(float(np.mean(one))) for one in off]
    rms = [float(np.sqrt(np.mean(one**2))) for one in off]
    rows = [
        row(f"{kind}: heights off, mean of a layer, largest", round(max(biases), 1), "µm"),
        row("  rms over level places, mean of layers", round(float(np.mean(rms)), 1), "µm"),
        row("  flat face off its height, rms", round(float(np.mean(told)), 1), "µm"),
        row("  sound layers with a gap found", false, f"of {layers}", "0", not false),
        row("  share of their way seen, mean", round(float(np.mean(seen)), 3), ""),
        row("  false gaps beside planted ones", beside, "", "0", not beside),
    ]
    for length, hits in gaps.items():
        of = f"of {len(hits)} seen, {layers} planted"
        rows.append(row(f"  gaps of {length:g} mm found", sum(hits), of, "all seen", all(hits)))
    return rows


def time_rows(folder: Path) -> list[dict[str, object]]:
    """Wall and CPU time from a sweep's pictures over 20 x 20 mm to what is found in it."""
    own = rig(1)
    found = fitted(own, folder)
    map_ = profiled(5, "solid", size=_BIG_MM, px=0.04)
    path, map_, _ = swept(own, map_, folder, _BIG_MM)
    rows, count = [], len(list(path.iterdir()))
    pages = folder / "look.tif"
    with tifffile.TiffWriter(pages, bigtiff=True) as tiff:
        for one in sorted(path.iterdir()):
            page = cv2.imread(str(one), cv2.IMREAD_GRAYSCALE)
            tiff.write(page, photometric="minisblack", contiguous=False)
    megapixels = SIZE[0] * SIZE[1] / 1e6
    for name, source in (("JPEG", path), ("TIFF, not compressed", pages)):
        judged(source, found, map_)
        begun, spent = time.perf_counter(), time.process_time()
        judged(source, found, map_)
        seconds, spent = time.perf_counter() - begun, time.process_time() - spent
        what = f"20 x 20 mm, {count} pictures of {megapixels:.1f} megapixels, {name}"
        rows.append(row(what, round(seconds, 2), "s", "<= 2", seconds <= 2))
        rows.append(row(f"{what}, both cores", round(spent, 2), "CPU s", "<= 2", spent <= 2))
    return rows


def main() -> None:
    """Run and print JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--layers", type=int, default=4)
    said = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = time_rows(folder)
        for kind in KINDS:
            rows += kind_rows(kind, said.layers, folder)
    print(json.dumps({"machine": machine(), "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
