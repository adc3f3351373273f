"""Draw random scan cases over all conditions of issue 22's table, for one overall count.

    python -m benchmarks.scan_bench --only count --count 100 --jobs 1 --first-seed 52000 --keep DIR

Each scan has a part (clean, changed, or broken), a pose and a light of its own. Every other scan
is in usual light, so that the hard end of the range doesn't hide what happens at the other.
"""

from __future__ import annotations

import numpy as np

from benchmarks.scans.cases import (
    BRIDGED_AT,
    BRIDGES,
    WIDEST_MM,
    Case,
    designs,
    joined,
    radius_mm,
)

KINDS = ("local", "clean", "whole", "local", "way", "local", "clean", "way", "local", "clean")
WAYS = ("leak", "bridge", "plug", "missing")
SYMMETRIC = {
    "shared": ("symmetric",),
    "spectral": ("half_turns", "quarter_turns", "mirrored_pair"),
}
PITCH_UM = 60
DEPTHS_UM = (12, 16, 20, 25)


def count(generator: str, seed: int) -> Case:
    """Return a scan drawn over contrast, noise, index, roughness, pose and what is printed."""
    rng = np.random.default_rng([seed, 7, len(generator)])
    names = sorted(designs(generator))
    design = str(rng.choice(names))
    kind = KINDS[seed % len(KINDS)]
    made: tuple[str, ...] = ()
    if kind == "clean" and rng.random() < 0.5:
        design, made = special(generator, design, rng)
    else:
        made = (*planted(generator, design, kind, rng), *turned(generator, design, rng))
    voxels = "--voxel-um=" + joined(PITCH_UM, PITCH_UM, float(rng.choice(DEPTHS_UM)))
    return Case(generator, design, seed, (*made, *light(bool(seed // 10 % 2), rng), voxels))


def planted(generator: str, design: str, kind: str, rng: np.random.Generator) -> tuple[str, ...]:
    """Return a change of 10 to 30 %, 0.2 to 3 mm or a vessel long, or a broken vessel."""
    vessel = int(rng.integers(designs(generator)[design]))
    amount = rng.uniform(0.10, 0.30) * rng.choice([-1, 1]) * radius_mm(generator, design, vessel)
    place = rng.uniform(0.35, 0.65)
    if kind == "whole":
        return ("--radius-change=" + joined(vessel, amount),)
    if kind == "local":
        sigma = np.exp(rng.uniform(np.log(0.2), np.log(3.0))) / 4
        return ("--bulge=" + joined(vessel, place, sigma, amount),)
    return broken(design, vessel, place, rng) if kind == "way" else ()


def broken(design: str, vessel: int, place: float, rng: np.random.Generator) -> tuple[str, ...]:
    """Return a leak, bridge, plug or missing vessel of at least 150 um."""
    way, width = str(rng.choice(WAYS)), rng.uniform(0.15, WIDEST_MM)
    if way == "leak":
        return ("--leak=" + joined(vessel, place, width),)
    if way == "bridge":
        one, other = BRIDGES[design]
        return ("--leak=" + joined(one, rng.uniform(*BRIDGED_AT), width, other),)
    if way == "plug":
        return ("--plug=" + joined(vessel, place, rng.uniform(0.15, 0.8)),)
    return ("--missing", str(vessel))


def turned(generator: str, design: str, rng: np.random.Generator) -> tuple[str, ...]:
    """Return a pose: half of them upright, half turned by any right angle or turned over.

    Only a part no deeper than light goes stands on any side.
    """
    if rng.random() < 0.5:
        return ()
    yaw = "--yaw=" + joined(rng.choice([0, 90, 180, 270]) + rng.uniform(-12, 12))
    if design == "compact" and rng.random() < 0.5:
        return ("--orientation", str(int(rng.integers(24))), yaw)
    return (yaw, *(("--turned-over",) if rng.random() < 0.6 else ()))


def special(generator: str, design: str, rng: np.random.Generator) -> tuple[str, tuple[str, ...]]:
    """Return a mirrored scan, half a part, or a symmetric design."""
    draw = rng.random()
    if draw < 0.45:
        return design, ("--mirror", str(rng.choice(list("xyz"))))
    if draw < 0.7:
        return design, ("--half-field",)
    symmetric = str(rng.choice(SYMMETRIC[generator]))
    return symmetric, turned(generator, symmetric, rng)


def light(usual: bool, rng: np.random.Generator) -> tuple[str, ...]:
    """Return options of light and roughness, over the whole range or in usual light."""
    noise, index, rough = (28, 35), 0.003, 15
    if not usual:
        noise, index, rough = (20, 35), 0.02, 40
    options = [
        "--snr-db=" + joined(rng.uniform(*noise)),
        "--index=" + joined(1.333 * rng.uniform(1 - index, 1 + index)),
        "--roughness-um=" + joined(rng.uniform(0, rough)),
    ]
    if rng.random() < 0.5:
        lowest = 8 if usual else 1.2
        contrast = np.exp(rng.uniform(np.log(lowest), np.log(50)))
        return (*options, "--contrast=" + joined(contrast))
    bath, lumen = (3, 6) if usual else (10, 15)
    bath, lumen = rng.uniform(0, bath), rng.uniform(1, lumen)
    return (*options, "--bath=" + joined(bath), "--lumen=" + joined(lumen))
