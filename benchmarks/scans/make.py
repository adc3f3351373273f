"""Make a synthetic spectral-domain OCT scan and keep its truth apart.

Writes PREFIX.tif, PREFIX.json (sidecar by docs/scans.md), PREFIX_truth.json, PREFIX_design/.

Modelled: discrete scatterers (see `scatter`), spectrometer (see `spectrometer`), confocal beam with
defocus, attenuation by each path's own media (lumens leave brighter stripes below them), multiple
scattering, reflections at gel's surfaces by slope, a group index per medium, B-scans that jitter.
Not modelled: bending of light at surfaces, fan and bow of the field, birefringence, bubbles.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import tifffile

from benchmarks.scans import geometry, scatter, truth
from benchmarks.scans.defects import Lumens, plant
from benchmarks.scans.designs import DESIGNS, Design
from benchmarks.scans.options import parser
from benchmarks.scans.part_files import write_design
from benchmarks.scans.pose import Pose, draw
from benchmarks.scans.spectrometer import FINE, Spectrometer, overlap

FILE_INDEX = 1.333
DB_LOW, DB_SPAN = -40.0, 60.0
CARRIER_PER_MM = 2 * 2 * np.pi * 1.333 / 1.3e-3


def main(argv: list[str] | None = None) -> int:
    """Make a scan."""
    asked = parser().parse_args(argv)
    rng = np.random.default_rng(asked.seed)
    design = DESIGNS[asked.design]()
    pose = draw(design, asked, rng)
    lumens = plant(design, asked)
    Path(asked.out).parent.mkdir(parents=True, exist_ok=True)
    write_design(design, Path(asked.out + "_design"))
    store(image(design, lumens, pose, asked, rng), asked)
    Path(asked.out + "_truth.json").write_text(json.dumps(truth.truth(design, lumens, pose, asked)))
    return 0


def image(
    design: Design, lumens: Lumens, pose: Pose, asked: argparse.Namespace, rng: np.random.Generator
) -> np.ndarray:
    """Return the linear intensities (z, y, x), 1 for gel at focus."""
    pitch, pitch_y, dz = (v / 1e3 for v in asked.voxel_um)
    nx, ny, nz = (
        int(np.ceil(e / s)) for e, s in zip(pose.extent, (pitch, pitch_y, dz), strict=True)
    )
    detector = Spectrometer(
        FINE * int(np.ceil(1.1 * nz / 4) * 4),
        dz / FINE,
        asked.resolution_um / 1e3,
        asked.rolloff_db_mm,
        asked.snr_db,
        asked.saturation,
        asked.stripes,
    )
    to_part = np.linalg.inv(pose.transform)
    boxes = piece_boxes(lumens, pose)
    balls = debris(design, asked, rng)
    media = optics(asked, detector)
    shape = (
        design.body.planes,
        np.array(design.body.cylinder),
        design.body.size,
        asked.swelling_um / 1e3,
    )
    rough = np.array([asked.roughness_um / 1e3, asked.grain_um / 1e3])
    parts = (lumens.pieces, lumens.radius, lumens.plugs, asked.sag_um / 1e3)
    field = np.empty((2, 3, nx, 2 * nz + 2), np.float32)
    out = np.zeros((nz, ny, nx), np.float32)
    beam = np.array([asked.beam_um / 1e3, asked.focus_mm, asked.rayleigh_mm])
    for j in range(ny):
        moved = to_part.copy()
        moved[:, 3] += to_part @ [
            *(asked.jitter_um / 1e3 * rng.standard_normal(3) * [1, 0, 0.5]),
            0,
        ]
        geometry.bscan(
            j * pitch_y,
            nx,
            pitch,
            2 * nz + 2,
            dz / 2,
            moved,
            boxes,
            shape,
            parts,
            rough,
            asked.seed,
            field,
        )
        geometry.strew(j * pitch_y, nx, pitch, 2 * nz + 2, dz / 2, moved, balls, field)
        for _ in range(asked.looks):
            light = back_scattered(field, dz / 2, pitch, detector, media, beam, asked, rng)
            shot = detector.image(overlap(light, beam, pitch, detector.delta), rng, 1.0)
            out[:, j] += shot[:, :: FINE // detector.pixel][:, :nz].T / asked.looks
    return out


def back_scattered(
    field: np.ndarray,
    dz_field: float,
    pitch: float,
    detector: Spectrometer,
    media: tuple[np.ndarray, ...],
    beam: np.ndarray,
    asked: argparse.Namespace,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return a B-scan's complex amplitude of singly and multiply scattered light, (nx, cells)."""
    light = np.zeros((field.shape[2], detector.cells), np.complex64)
    mean = np.zeros(light.shape, np.float32)
    scatter.cast(
        field,
        dz_field,
        detector.delta,
        asked.per_cell,
        *media,
        beam,
        relative_index(asked),
        specular(asked, detector),
        CARRIER_PER_MM,
        int(rng.integers(2**31)),
        light,
        mean,
    )
    late = int(rng.integers(2**31))
    scatter.tail(mean, detector.delta, asked.tail, 0.25, int(0.15 / pitch), late, light)
    return light


def optics(
    asked: argparse.Namespace, detector: Spectrometer
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return density, power and attenuation of gel, lumen and bath."""
    shared = 100 / asked.contrast if asked.contrast else None

    def share(own: float | None, usual: float) -> float:
        return (own if own is not None else shared if shared is not None else usual) / 100

    power = np.array([1.0, share(asked.lumen, 2.0), share(asked.bath, 0.5)])
    power = np.maximum(power, 1e-6)
    return np.sqrt(power), power, asked.attenuation_per_mm * power


def relative_index(asked: argparse.Namespace) -> np.ndarray:
    """Return group indices of gel, lumen and bath over the liquid's."""
    gel = asked.gel_index or asked.index
    return np.array([gel / asked.index, 1.0, 1.0])


def specular(asked: argparse.Namespace, detector: Spectrometer) -> np.ndarray:
    """Return amplitude, width in slope (lens: 3 degrees) and diffuse share of reflections."""
    return np.array([detector.reflection(1.0, asked.reflection_db), np.tan(np.radians(3.0)), 0.2])


def piece_boxes(lumens: Lumens, pose: Pose) -> np.ndarray:
    """Return low and high corners (n, 6) of each piece in the scan, mm, 0.25 mm to spare."""
    ends = np.stack([lumens.pieces[:, 0:3], lumens.pieces[:, 3:6]])
    ends = ends @ pose.transform[:3, :3].T + pose.transform[:3, 3]
    spare = lumens.radius.max(axis=1)[lumens.pieces[:, 8].astype(int)][:, None] * 1.1 + 0.25
    return np.hstack([ends.min(axis=0) - spare, ends.max(axis=0) + spare])


def debris(design: Design, asked: argparse.Namespace, rng: np.random.Generator) -> np.ndarray:
    """Return grains of gel in the lumens: place (part, mm) and radius, (n, 4)."""
    out = []
    for _ in range(asked.debris):
        vessel = design.vessels[rng.integers(len(design.vessels))]
        along = rng.uniform(0.1, 0.9) * vessel.along[-1]
        aside = rng.uniform(-0.5, 0.5, 3) * float(vessel.radius_at(along))
        out.append([*(vessel.at(along) + aside), rng.uniform(0.03, 0.07)])
    return np.array(out).reshape(-1, 4)


def store(intensity: np.ndarray, asked: argparse.Namespace) -> None:
    """Write the TIFF and its sidecar."""
    if asked.mirror:
        intensity = np.flip(intensity, "zyx".index(asked.mirror))
    if asked.depth_up:
        intensity = intensity[::-1]
    values, meaning = grey_values(intensity.transpose(["zyx".index(a) for a in asked.axes]), asked)
    tifffile.imwrite(
        asked.out + ".tif", values, photometric="minisblack", metadata=None, description=meaning
    )
    x, y, z = (v / 1e3 for v in asked.voxel_um)
    said = {
        "voxel_mm": [z * asked.index / FILE_INDEX, y, x],
        "axes": asked.axes,
        "modality": "oct",
        "scale": "db" if asked.db else "linear",
        "depth_down": not asked.depth_up,
        "refractive_index": FILE_INDEX,
        "optical_depth": False,
    }
    Path(asked.out + ".json").write_text(json.dumps(said))


def grey_values(intensity: np.ndarray, asked: argparse.Namespace) -> tuple[np.ndarray, str]:
    """Return the stored array and a line that says what it holds."""
    values = 10 * np.log10(np.maximum(intensity, 1e-9)) if asked.db else intensity
    if asked.dtype == "float32":
        return values.astype(np.float32), "dB" if asked.db else "linear intensity"
    top = np.iinfo(asked.dtype).max
    if asked.db:
        counts = (values - DB_LOW) / DB_SPAN * top
        return np.clip(counts, 0, top).round().astype(
            asked.dtype
        ), f"dB = {DB_LOW:g} + {DB_SPAN:g} * value / {top}"
    full = float(np.percentile(values, 99.99))
    return np.clip(values / full * top, 0, top).round().astype(
        asked.dtype
    ), f"linear intensity, {top} = {full:.4g} of the gel"


if __name__ == "__main__":
    sys.exit(main())
