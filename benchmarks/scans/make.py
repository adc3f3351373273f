"""Make a synthetic spectral-domain OCT scan and keep its truth apart.

Writes PREFIX.tif, PREFIX.json (sidecar by docs/scans.md), PREFIX_truth.json, PREFIX_design/.

Modelled: discrete scatterers (see `scatter`), spectrometer (see `spectrometer`), confocal beam with
defocus, attenuation by each path's own media (lumens leave brighter stripes below them), multiple
scattering, reflections at gel's surfaces by slope.
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
from benchmarks.scans.designs import DESIGNS, Design, write_design
from benchmarks.scans.options import parser
from benchmarks.scans.pose import Pose, draw
from benchmarks.scans.spectrometer import FINE, PIXEL, Spectrometer, overlap

FILE_INDEX = 1.333
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
    nx, ny, nz = np.ceil(pose.extent / (pitch, pitch_y, dz)).astype(int).tolist()
    fine, cells = 2 * nz + 2, FINE * int(np.ceil(1.1 * nz / 4) * 4)
    detector = Spectrometer(
        cells, dz / FINE, asked.resolution_um / 1e3, asked.rolloff_db_mm, asked.snr_db
    )
    delta = detector.delta
    to_part, boxes = np.linalg.inv(pose.transform), piece_boxes(lumens, pose)
    density, power, loss = optics(asked)
    # Amplitude, width in slope (lens: 3 degrees) and diffuse share of reflections.
    specular = [detector.reflection(asked.reflection_db), np.tan(np.radians(3.0)), 0.2]
    shape = (design.body.planes, np.array(design.body.cylinder))
    rough = np.array([asked.roughness_um / 1e3, asked.grain_um / 1e3])
    parts = (lumens.pieces, lumens.radius, lumens.plugs)
    field = np.empty((2, 3, nx, fine), np.float32)
    out = np.zeros((nz, ny, nx), np.float32)
    beam = np.array([asked.beam_um / 1e3, asked.focus_mm, asked.rayleigh_mm])
    for j in range(ny):
        geometry.bscan(
            j * pitch_y, nx, pitch, fine, dz / 2, to_part, boxes, shape, parts, rough, asked.seed,
            field,
        )  # fmt: skip
        for _ in range(asked.looks):
            light, mean = np.zeros((nx, cells), np.complex64), np.zeros((nx, cells), np.float32)
            scatter.cast(
                field, dz / 2, delta, asked.per_cell, density, power, loss, beam, np.ones(3),
                np.array(specular), CARRIER_PER_MM, int(rng.integers(2**31)), light, mean,
            )  # fmt: skip
            late = int(rng.integers(2**31))
            scatter.tail(mean, delta, asked.tail, 0.25, int(0.15 / pitch), late, light)
            shot = detector.image(overlap(light, beam, pitch, delta), rng)
            out[:, j] += shot[:, :: FINE // PIXEL][:, :nz].T / asked.looks
    return out


def optics(asked: argparse.Namespace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return density, power and attenuation of gel, lumen and bath."""
    shared = 100 / asked.contrast if asked.contrast else None

    def share(own: float | None, usual: float) -> float:
        return (own if own is not None else shared if shared is not None else usual) / 100

    power = np.maximum([1.0, share(asked.lumen, 2.0), share(asked.bath, 0.5)], 1e-6)
    return np.sqrt(power), power, asked.attenuation_per_mm * power


def piece_boxes(lumens: Lumens, pose: Pose) -> np.ndarray:
    """Return low and high corners (n, 6) of each piece in the scan, mm, 0.25 mm to spare."""
    ends = np.stack([lumens.pieces[:, 0:3], lumens.pieces[:, 3:6]])
    ends = ends @ pose.transform[:3, :3].T + pose.transform[:3, 3]
    spare = lumens.radius.max(axis=1)[lumens.pieces[:, 8].astype(int)][:, None] * 1.1 + 0.25
    return np.hstack([ends.min(axis=0) - spare, ends.max(axis=0) + spare])


def store(intensity: np.ndarray, asked: argparse.Namespace) -> None:
    """Write the TIFF and its sidecar."""
    if asked.mirror:
        intensity = np.flip(intensity, "zyx".index(asked.mirror))
    tifffile.imwrite(asked.out + ".tif", intensity, photometric="minisblack", metadata=None)
    x, y, z = (v / 1e3 for v in asked.voxel_um)
    facts: dict[str, object] = {"voxel_mm": [z * asked.index / FILE_INDEX, y, x], "axes": "zyx"}
    facts |= {"modality": "oct", "scale": "linear", "depth_down": True, "optical_depth": False}
    Path(asked.out + ".json").write_text(json.dumps(facts | {"refractive_index": FILE_INDEX}))


if __name__ == "__main__":
    sys.exit(main())
