"""Registration of two simulated parts: time, memory, poses from many starts, diameters.

Parts and deposits are those of ``tests/registration``, scans the simulator's. Generators that share
no code with the product are `benchmarks.scans`'.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import manifold3d
import numpy as np
import tifffile
import trimesh
from scipy.spatial.transform import Rotation

from benchmarks.common import Row, at_least, limited, printctl, row, scratch, timed
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.solids import Solid
from gcode.deposit.lay import Deposit
from kernels.arrays import FloatArray
from registration import register_scan
from registration.alignment import align
from registration.alignment.distance import ModelSurface
from registration.segmentation import Segmentation, SegmentationOptions, segment
from sim.devices.scanner.oct import OctOptions, simulate_oct
from sim.devices.scanner.placing import Placing
from tests.registration import parts

SIZE_MM = np.array([11.0, 5.6, 2.6])
SHRUNK = Placing(rotation_deg=12.0, shrink=(0.98, 0.978, 0.975))
COARSE = OctOptions(voxel_mm=(0.040, 0.030, 0.030), attenuation_mm=0.6, placing=SHRUNK)
FINE = replace(COARSE, voxel_mm=(0.0215, 0.018, 0.017))
LEVEL = Placing(rotation_deg=4.0, tilt_deg=1.0, shrink=SHRUNK.shrink)
WHOLE = replace(COARSE, voxel_mm=(0.0235, 0.0195, 0.0172), placing=LEVEL)
"""Some 1000 x 500 x 250 voxels."""
LIGHTS = (
    COARSE,
    replace(COARSE, signal_db=27.0, looks=1),
    replace(COARSE, signal_db=26.0, attenuation_mm=0.9, looks=2),
)
LANDED_UM = 100.0
INK_MM, FINE_INK_MM = 0.03, 0.015
"""Edges of the ink's voxels."""


class Part(NamedTuple):
    """A part as designed, and its ink by the edge of the voxels, mm."""

    network: VesselNetwork
    solid: Solid
    printed: Callable[[float], Deposit]
    size_mm: FloatArray


@cache
def planar() -> Part:
    """Return four parallel channels of 0.4 to 0.8 mm between two manifolds."""
    net, solid = parts.planar_network(), parts.planar_construct()
    return Part(net, solid, parts.planar_deposit, np.array(parts.BLOCK))


@cache
def branched() -> Part:
    """Return a tree of 15 vessels of 0.4 to 0.8 mm through the whole depth of a block."""
    places = [(0.0, 2.8, 1.3), (2.2, 2.8, 1.3), (4.6, 1.5, 0.8), (4.6, 4.1, 1.8)]
    places += [(7.4, 0.7, 0.6), (7.4, 2.2, 1.5), (7.4, 3.3, 1.2), (7.4, 4.9, 2.0)]
    tips = [(0.5, 1.6), (1.3, 0.5), (1.9, 2.0), (2.7, 0.7), (3, 1.9), (3.9, 0.6), (4.5, 1.3)]
    places += [(11.0, y, z) for y, z in [*tips, (5.1, 2.1)]]
    ends = np.array([(0, 1), *((1 + k // 2, 2 + k) for k in range(14))])
    radius = np.array([0.4] + [0.32] * 2 + [0.25] * 4 + [0.2] * 8)
    kind = np.zeros(len(ends), dtype=np.int64)
    network = VesselNetwork.from_segments(np.array(places), ends, radius, kind, kind)

    def distance(points: FloatArray) -> FloatArray:
        box = (np.abs(points - SIZE_MM / 2) - SIZE_MM / 2).max(axis=-1)
        return np.maximum(box, -parts.lumen_distance(network, points))

    @cache
    def printed(voxel: float) -> Deposit:
        return parts.analytic_deposit(distance, np.zeros(3), SIZE_MM, voxel)

    block = manifold3d.Manifold.cube(SIZE_MM.tolist()) - parts.lumens(network)
    return Part(network, parts.solid(block), printed, SIZE_MM)


def whole_rows(quick: bool) -> Iterator[Row]:
    """Yield time and memory of ``printctl register`` on a file of some 125 million voxels."""
    part = planar()
    scanned = simulate_oct(part.printed(INK_MM), COARSE if quick else WHOLE, 1)
    dz, dy, dx = scanned.voxel_mm
    with scratch() as folder:
        tifffile.imwrite(folder / "scan.tif", scanned.volume)
        mesh = trimesh.Trimesh(part.solid.vertices, part.solid.faces, process=False)
        mesh.export(folder / "part.stl")
        write_network_csv(folder / "network.csv", part.network)
        given = ["--model", folder / "part.stl", "--voxel-um", f"{1e3 * dx},{1e3 * dy},{1e3 * dz}"]
        given += ["--refractive-index", "1.34", "--optical-depth", "--modality", "oct", "--json"]
        given += ["--scale", "linear", "--depth-down", "--axes", "ZYX", "--out", folder / "out"]
        # As users run it: Python keeps what it has compiled of the sources.
        command = ["env", "-u", "PYTHONDONTWRITEBYTECODE"]
        command += printctl("register", folder / "scan.tif", *given)
        runs = []
        for _ in range(1 if quick else 4):  # the first fills the disk's cache
            began = time.monotonic()
            cpu, memory, _ = timed(command, allowed=(0, 3))
            runs.append((time.monotonic() - began, cpu, memory))
    wall, cpu, memory = np.median(np.array(runs[-3:]), axis=0).tolist()
    name = " x ".join(map(str, scanned.volume.shape[::-1])) + " voxels to report"
    yield limited(f"{name}: wall clock", wall, "s", 8.0) | {"cpu_s": cpu}
    yield limited(f"{name}: memory", memory / 1e3, "GB", 1.2)


def diameter_rows(quick: bool) -> Iterator[Row]:
    """Yield errors of all vessels' diameters in clean scans; quick has a coarse one, no bar."""
    errors: list[float] = []
    ink_mm = INK_MM if quick else FINE_INK_MM
    options = replace(COARSE if quick else FINE, placing=Placing(shrink=(0.98, 0.98, 0.98)))
    for part in (planar(),) if quick else (planar(), branched()):
        for seed in range(1 if quick else 3):
            scan = parts.as_scan(simulate_oct(part.printed(ink_mm), options, seed))
            for vessel in register_scan(scan, part.solid, part.network).vessels:
                off = vessel.diameter_um - 0.98 * vessel.designed_um
                errors += off[np.isfinite(off)].tolist()
    bias, spread = float(np.mean(errors)), float(np.std(errors))
    yield row("diameters: bias", bias, "um", *(() if quick else ("within 5", abs(bias) <= 5)))
    yield limited("diameters: sd over all sections", spread, "um", 15.0)


class Start(NamedTuple):
    """Outcome of one start: target registration errors (n,), µm, scale error (3,), flagged."""

    off_um: FloatArray
    scale: FloatArray
    flagged: bool

    @property
    def landed(self) -> bool:
        """Whether each place is near where it should be."""
        return bool(self.off_um.max() < LANDED_UM)


def landing_rows(quick: bool) -> Iterator[Row]:
    """Yield starts all round, tilted by up to 10 degrees and shifted by up to 3 mm."""
    for name, part in (("planar", planar()), ("branched", branched())):
        found = list(starts_of(part, *((1, 1, 1) if quick else (3, 5, 10))))
        landed = [one for one in found if one.landed]
        share = 100 * len(landed) / len(found)
        yield at_least(f"{name}: starts that land", share, "%", 99) | {"starts": len(found)}
        missed = sum(not one.landed and not one.flagged for one in found)
        yield limited(f"{name}: misses not flagged", missed, "", 0)
        flagged = 100 * float(np.mean([one.flagged for one in landed]))
        yield limited(f"{name}: good poses flagged", flagged, "%", 2)
        mean = float(np.mean([one.off_um for one in landed]))
        most = max(float(np.percentile(one.off_um, 95)) for one in landed)
        yield limited(f"{name}: target registration error, scaled fit, mean", mean, "um", 2)
        yield limited(f"{name}: the same, 95 %, worst scan", most, "um", 6)
        worst = 100 * np.abs([one.scale for one in landed]).max(axis=0)
        yield limited(f"{name}: scale in plane, worst", float(worst[:2].max()), "%", 0.06)
        yield limited(f"{name}: scale in depth, worst", float(worst[2]), "%", 0.3)


def starts_of(part: Part, lights: int, seeds: int, starts: int) -> Iterator[Start]:
    """Scan a part in several lights; register each scan's surface from many places."""
    model, rng = ModelSurface.of(part.solid), np.random.default_rng(3)
    for options in LIGHTS[:lights]:
        for seed in range(seeds):
            scanned = simulate_oct(part.printed(INK_MM), options, seed)
            seen = segment(parts.as_scan(scanned), SegmentationOptions(working_voxel_mm=0.4 / 12))
            for _ in range(starts):
                yield _start(part, model, seen, scanned.pose_truth, rng)


def _start(
    part: Part, model: ModelSurface, seen: Segmentation, truth: FloatArray, rng: np.random.Generator
) -> Start:
    """Move the scanned surface anywhere, and let the product find it."""
    points = seen.surface.vertices[seen.seen]
    about = Rotation.from_euler("z", rng.uniform(0, 360), degrees=True)
    turn = (about * Rotation.from_euler("xy", rng.uniform(-10, 10, 2), degrees=True)).as_matrix()
    shift = points.mean(axis=0) + rng.uniform(-3, 3, 3) - turn @ points.mean(axis=0)
    found = align(model, points @ turn.T + shift, True, blur_mm=seen.field.blur_mm)
    places = np.stack(np.meshgrid(*(np.linspace(0, side, 5) for side in part.size_mm)), axis=-1)
    places = places.reshape(-1, 3)
    scan = ((places + parts.PLACE) @ truth[:3, :3].T + truth[:3, 3]) @ turn.T + shift
    back = scan @ found.scaled.matrix[:3, :3].T + found.scaled.matrix[:3, 3]
    off_um = 1e3 * np.linalg.norm(back - places, axis=1)
    return Start(off_um, found.scaled.scale / SHRUNK.shrink - 1, found.ambiguous)
