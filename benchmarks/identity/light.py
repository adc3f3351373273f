"""Scans of prints by three generators: the product's, the shared one, and one made here.

The one made here shares no light with the others. Modelled: attenuation by the mean of the gel
above in a wide cone (so lumens throw no sharp stripes), a blur that grows with depth, gamma
speckle of about five looks with grains longer across than along the light, stripes of A-scans that
absorbers dim, a liquid that scatters a few percent, a floor of additive noise. Not modelled:
reflections, particles, refraction, roll-off.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
from dataclasses import replace
from importlib import import_module
from itertools import product
from pathlib import Path

import numpy as np
import trimesh
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.spatial.transform import Rotation

from benchmarks.common import ROOT, needed
from benchmarks.identity.prints import Print
from design.network_files.csv_format import write_network_csv
from kernels.arrays import FloatArray
from registration import Scan, read_scan
from sim.devices.scanner.oct import OctOptions, simulate_oct
from sim.devices.scanner.placing import Placing
from tests.registration import parts

GENERATORS = ("product", "shared", "own")
SHARED = ROOT.parent / "shared" / "scans"
INK_MM = 0.045
VOXEL_MM = (0.035, 0.06, 0.06)
LOOKS = 5.0
MARGIN_MM = np.array([0.4, 0.4, 0.3])


def scan_of(printed: Print, generator: str, rng: np.random.Generator) -> Scan:
    """Scan a print."""
    return {"product": _product, "shared": _shared, "own": _own}[generator](printed, rng)


def _product(printed: Print, rng: np.random.Generator) -> Scan:
    ink = parts.analytic_deposit(printed.distance, np.zeros(3), printed.design.size_mm, INK_MM)
    noisy, dim = printed.damage == "noisy", printed.damage == "dim"
    sx, sy, sz = printed.scale.tolist()
    options = OctOptions(
        voxel_mm=(0.048, 0.06, 0.06),
        signal_db=float(rng.uniform(19, 24) if noisy else rng.uniform(27, 35)),
        attenuation_mm=float(rng.uniform(1.2, 2.0) if dim else rng.uniform(0.4, 0.9)),
        looks=1 if noisy else 3,
        placing=Placing(rotation_deg=float(rng.choice([12.0, 180.0])), shrink=(sx, sy, sz)),
    )
    return _seen(printed, parts.as_scan(simulate_oct(ink, options, int(rng.integers(2**31)))))


def _seen(printed: Print, scan: Scan) -> Scan:
    """Return the half of a scan that is in view, where the print says so."""
    if printed.damage != "half":
        return scan
    half = scan.volume[:, :, : scan.volume.shape[2] // 2]
    return replace(scan, volume=np.ascontiguousarray(half))


def _own(printed: Print, rng: np.random.Generator) -> Scan:
    design, damage = printed.design, printed.damage
    turn = Rotation.from_euler(
        "zyx", [rng.choice([0, 180]) + rng.uniform(-12, 12), *rng.uniform(-3, 3, 2)], degrees=True
    ).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    linear = turn @ np.diag(printed.scale)
    corners = (np.array(list(product((0, 1), repeat=3))) * design.size_mm) @ linear.T
    low, high = corners.min(axis=0) - MARGIN_MM, corners.max(axis=0) + MARGIN_MM
    dz, dy, dx = VOXEL_MM
    nx, ny, nz = np.ceil((high - low) / (dx, dy, dz)).astype(int).tolist()
    back, gel = np.linalg.inv(linear), np.empty((nz, ny, nx), dtype=np.float32)
    y, x = np.meshgrid(dy * np.arange(ny), dx * np.arange(nx), indexing="ij")
    for k in range(nz):
        places = (np.stack([x, y, np.full_like(x, k * dz)], axis=-1) + low) @ back.T
        gel[k] = np.clip(0.5 - printed.distance(places) / 0.04, 0, 1)
    return _seen(
        printed,
        Scan(
            volume=_lit(gel, damage, rng),
            voxel_mm=VOXEL_MM,
            refractive_index=1.35,
            optical_depth=False,
            scale="linear",
            modality="oct",
            depth_down=True,
            came_from=Path("own"),
        ),
    )


def _lit(gel: FloatArray, damage: str, rng: np.random.Generator) -> FloatArray:
    """Send light through shares of gel (nz, ny, nx); return intensities, 1 for gel at the top."""
    dz, dy, dx = VOXEL_MM
    loss = rng.uniform(1.0, 1.6) if damage == "dim" else rng.uniform(0.3, 0.7)
    liquid = rng.uniform(0.01, 0.05) if damage != "noisy" else rng.uniform(0.05, 0.12)
    floor = 10 ** (-rng.uniform(18, 22 if damage == "noisy" else 30) / 10)
    above = gaussian_filter(gel, (0.0, 0.2 / dy, 0.2 / dx)).cumsum(axis=0) * dz
    light = np.exp(-2 * loss * above)
    stripes = gaussian_filter1d(rng.standard_normal(gel.shape[1:]), 2.0, axis=0)
    light *= np.exp(-0.25 * np.maximum(stripes / stripes.std() - 1.2, 0))[None]
    mean = (liquid + (1 - liquid) * gel) * light
    deep = gaussian_filter(mean, (0.0, 0.03 / dy, 0.03 / dx))
    part = np.linspace(0, 1, len(gel))[:, None, None]
    mean = (1 - part) * mean + part * deep
    grains = gaussian_filter(rng.standard_normal((2, *gel.shape)), (0, 0.4, 0.6, 0.6))
    grains /= grains.std()
    speckle = (grains**2).mean(axis=0)
    speckle = 0.5 * speckle + 0.5 * rng.gamma(LOOKS, 1 / LOOKS, gel.shape)
    noise = floor * (1 + 0.7 * rng.standard_normal(gel.shape))
    return np.maximum(mean * speckle + noise, 0).astype(np.float32)


def _shared(printed: Print, rng: np.random.Generator) -> Scan:
    needed(SHARED / "make_scan.py", "the shared generator of scans")
    if str(SHARED) not in sys.path:
        sys.path.append(str(SHARED))
    design = printed.design
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        trimesh.Trimesh(design.solid.vertices, design.solid.faces).export(folder / "part.stl")
        write_network_csv(folder / "network.csv", design.network)
        out = str(folder / "scan")
        command = [str(folder), out, "--seed", str(int(rng.integers(2**31)))]
        with contextlib.redirect_stdout(io.StringIO()):
            import_module("make_scan").main([*command, *_asked(printed, rng)])
        return read_scan(Path(out + ".tif"))


def _asked(printed: Print, rng: np.random.Generator) -> list[str]:
    """Return the shared generator's options for a print."""
    noisy, dim = printed.damage == "noisy", printed.damage == "dim"
    options = ["--voxel-um=60,60,35", "--shrink=" + _joined(*printed.scale)]
    options.append(f"--yaw={rng.choice([0, 180]) + rng.uniform(-12, 12):.4g}")
    options.append(f"--snr-db={rng.uniform(20, 24) if noisy else rng.uniform(28, 35):.4g}")
    if dim:
        options.append(f"--contrast={rng.uniform(1.2, 4):.4g}")
    if printed.damage == "half":
        options.append("--half-field")
    for vessel in printed.plugged:
        options += ["--missing", str(vessel)]
    for k in range(len(printed.leaks)):
        vessel = int(rng.integers(len(printed.design.ends)))
        options.append("--leak=" + _joined(vessel, 0.4 + 0.1 * k, 2 * printed.leak_mm))
    if printed.narrower_mm:
        for vessel in range(len(printed.design.ends)):
            options.append("--radius-change=" + _joined(vessel, -printed.narrower_mm))
    return options


def _joined(*values: float) -> str:
    return ",".join(f"{value:.5g}" for value in values)
