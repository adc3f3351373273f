"""Poses of phantom scans from many starts: how many land, their error and scale."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.common import Row, row
from benchmarks.registration.phantom import (
    Design,
    Light,
    Setting,
    Truth,
    branched,
    moved,
    planar,
    scan_of,
)
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from design.solids import Solid
from registration.alignment import align
from registration.alignment.distance import ModelSurface
from registration.scan import Scan
from registration.segmentation import Segmentation, SegmentationOptions, segment

FloatArray = NDArray[np.float64]

#: A scan of the same field at a sixth of the voxels.
COARSE: dict[str, Any] = {"shape": (500, 250, 100), "voxel_mm": (0.030, 0.030, 0.030)}


@dataclass(frozen=True)
class Case:
    """One scan and its truth."""

    scan: Scan
    truth: Truth


def case(design: Design, setting: Setting, seed: int) -> Case:
    """Scan a design."""
    volume, truth = scan_of(design, setting, seed)
    dx, dy, dz = setting.voxel_mm
    scan = Scan(volume, (dz, dy, dx), 1.34, False, "linear", "oct", True, Path(design.name))
    return Case(scan, truth)


def as_designed(design: Design) -> tuple[Solid, VesselNetwork]:
    """Mesh and network as the product takes them."""
    vertices, faces = design.mesh()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.csv"
        path.write_text(design.csv())
        return Solid(vertices.astype(np.float64), faces), read_network_csv(path, "mm")


def targets(design: Design) -> FloatArray:
    """Places all over the part, (125, 3), mm."""
    axes = [np.linspace(0, size, 5) for size in design.size]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)


def errors_um(design: Design, truth: FloatArray, found: FloatArray) -> FloatArray:
    """Target registration error at each place, µm: part to scan by truth, back by the product."""
    part = targets(design)
    scan = part @ truth[:3, :3].T + truth[:3, 3]
    return np.asarray(1e3 * np.linalg.norm(scan @ found[:3, :3].T + found[:3, 3] - part, axis=1))


LANDED_UM = 100.0
LIGHTS = (
    Light(),
    Light(counts=4000.0, looks=1, liquid=0.1),
    Light(counts=8000.0, attenuation_mm=0.9, noise=20.0, looks=2),
)


@dataclass
class Tally:
    """What came of the starts of one design."""

    starts: int = 0
    landed: int = 0
    missed_unflagged: int = 0
    flagged_good: int = 0
    flagged: int = 0
    mean_um: list[float] = field(default_factory=list)
    p95_um: list[float] = field(default_factory=list)
    scale: list[FloatArray] = field(default_factory=list)


def landing_rows(quick: bool) -> Iterator[Row]:
    """Yield starts all round, tilted by up to 10 degrees and shifted by up to 3 mm."""
    seeds, starts, lights = (1, 1, LIGHTS[:1]) if quick else (5, 20, LIGHTS)
    for design in (planar(), branched()):
        found = _tally(design, seeds, starts, lights)
        part = 100 * found.landed / found.starts
        about = {"starts": found.starts, "design": design.name}
        yield row(f"{design.name}: starts that land", part, "%", ">= 99", part >= 99) | about
        missed = found.missed_unflagged
        yield row(f"{design.name}: misses not flagged", missed, "", "0", missed == 0)
        value = 100 * found.flagged_good / max(found.landed, 1)
        yield row(f"{design.name}: good poses flagged", value, "%", "<= 2", value <= 2)
        mean, high = float(np.mean(found.mean_um)), float(np.max(found.p95_um))
        name = f"{design.name}: target registration error, scaled fit"
        yield row(f"{name}, mean", mean, "um", "<= 2", mean <= 2)
        yield row(f"{name}, p95, the worst scan", high, "um", "<= 6", high <= 6)
        worst = 100 * np.abs(np.array(found.scale)).max(axis=0)
        plane, depth = float(worst[:2].max()), float(worst[2])
        yield row(f"{design.name}: scale in plane, worst", plane, "%", "<= 0.06", plane <= 0.06)
        yield row(f"{design.name}: scale in depth, worst", depth, "%", "<= 0.3", depth <= 0.3)
    found = _tally(planar(marked=False), 1, starts, lights)
    part = 100 * found.flagged / found.starts
    yield row("symmetric design: poses flagged", part, "%", "100", part == 100)


def _tally(design: Design, seeds: int, starts: int, lights: Sequence[Light]) -> Tally:
    surface = ModelSurface.of(as_designed(design)[0])
    tally, rng = Tally(), np.random.default_rng(3)
    for light in lights:
        for seed in range(seeds):
            here = case(design, moved(Setting(**COARSE), light=light), seed)
            seen = _segmented(here)
            for _ in range(starts):
                _start(tally, design, surface, here, seen, rng)
    return tally


def _start(
    tally: Tally,
    design: Design,
    surface: ModelSurface,
    here: Case,
    seen: Segmentation,
    rng: np.random.Generator,
) -> None:
    """Move the scanned surface anywhere, and let the product find it."""
    points = seen.surface.vertices[seen.seen]
    about = Rotation.from_euler("z", rng.uniform(0, 360), degrees=True)
    tilt = Rotation.from_euler("xy", rng.uniform(-10, 10, 2), degrees=True)
    turn = (about * tilt).as_matrix()
    shift = points.mean(axis=0) + rng.uniform(-3, 3, 3) - turn @ points.mean(axis=0)
    found = align(surface, points @ turn.T + shift, True, blur_mm=seen.field.blur_mm)
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = turn, shift
    error = errors_um(design, move @ here.truth.scan_from_part, found.scaled.matrix)
    good = bool(error.max() < LANDED_UM)
    tally.starts += 1
    tally.landed += good
    tally.flagged += found.ambiguous
    tally.missed_unflagged += not good and not found.ambiguous
    tally.flagged_good += good and found.ambiguous
    if good:
        tally.mean_um.append(float(error.mean()))
        tally.p95_um.append(float(np.percentile(error, 95)))
        tally.scale.append(found.scaled.scale / here.truth.stretch - 1)


def _segmented(here: Case) -> Segmentation:
    return segment(here.scan, SegmentationOptions(working_voxel_mm=0.4 / 12))
