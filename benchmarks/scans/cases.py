"""Random scans over all conditions that `printctl register` has to stand, drawn from a seed.

Each scan has a part (clean, changed, or broken), a pose and a light of its own. Every other scan
is in usual light, so that the hard end of the range doesn't hide what happens at the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SHARED = {
    "block": (0.25, 0.35, 0.45, 0.2),
    "tree": (0.45, 0.36, 0.34, 0.28, 0.25, 0.26, 0.24),
    "loop": (0.28,) * 10 + (0.35, 0.3, 0.2),
}
SPECTRAL = {
    "curved": (0.43, 0.35, 0.33, 0.25, 0.25, 0.24, 0.22, 0.24),
    "slanted": (0.225, 0.35, 0.24, 0.25),
    "drum": (0.375, 0.25, 0.3, 0.2),
    "compact": (0.3, 0.225, 0.2, 0.18),
}
DESIGNS_OF = {"shared": SHARED, "spectral": SPECTRAL}
"""Generators' designs for general use: about the radii of their vessels, mm."""
# Vessels for a bridge, from the first to the nearest place of the second: between `BRIDGED_AT` of
# the first's length a way as wide as `WIDEST_MM` meets no third and doesn't lead outside.
BRIDGES = {
    "block": (0, 1),
    "tree": (3, 4),
    "loop": (3, 12),
    "curved": (0, 7),
    "slanted": (1, 0),
    "drum": (0, 3),
    "compact": (3, 2),
}
BRIDGED_AT = (0.45, 0.65)
WIDEST_MM = 0.4
TOLERANCE_PERCENT = 10.0


KINDS = ("local", "clean", "whole", "local", "way", "local", "clean", "way", "local", "clean")
WAYS = ("leak", "bridge", "plug", "missing")
PITCH_UM = 60
DEPTHS_UM = (12, 16, 20, 25)


@dataclass(frozen=True)
class Case:
    """A scan to make, by which generator ("shared", "spectral"), with which options of it."""

    generator: str
    design: str
    seed: int
    options: tuple[str, ...] = ()


def joined(*values: float) -> str:
    """Return numbers separated by commas, short."""
    return ",".join(f"{v:.4g}" for v in values)


def draw_case(generator: str, seed: int) -> Case:
    """Return a scan drawn over contrast, noise, index, roughness, pose and what is printed."""
    rng = np.random.default_rng([seed, 7, len(generator)])
    names = sorted(DESIGNS_OF[generator])
    design = str(rng.choice(names))
    kind = KINDS[seed % len(KINDS)]
    made: tuple[str, ...] = ()
    if kind == "clean" and rng.random() < 0.5:
        made = (
            ("--half-field",) if rng.random() < 0.4 else ("--mirror", str(rng.choice(list("xyz"))))
        )
    else:
        made = (*planted(generator, design, kind, rng), *turned(design, rng))
    voxels = "--voxel-um=" + joined(PITCH_UM, PITCH_UM, float(rng.choice(DEPTHS_UM)))
    return Case(generator, design, seed, (*made, *light(bool(seed // 10 % 2), rng), voxels))


def planted(generator: str, design: str, kind: str, rng: np.random.Generator) -> tuple[str, ...]:
    """Return a change of 10 to 30 %, 0.2 to 3 mm or a vessel long, or a broken vessel."""
    radii = DESIGNS_OF[generator][design]
    vessel = int(rng.integers(len(radii)))
    amount = rng.uniform(0.10, 0.30) * rng.choice([-1, 1]) * radii[vessel]
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


def turned(design: str, rng: np.random.Generator) -> tuple[str, ...]:
    """Return a pose: half of them upright, half turned by any right angle or turned over.

    Only a part no deeper than light goes stands on any side.
    """
    if rng.random() < 0.5:
        return ()
    yaw = "--yaw=" + joined(rng.choice([0, 90, 180, 270]) + rng.uniform(-12, 12))
    if design == "compact" and rng.random() < 0.5:
        return ("--orientation", str(int(rng.integers(24))), yaw)
    return (yaw, *(("--turned-over",) if rng.random() < 0.6 else ()))


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
    most = (3, 6) if usual else (10, 15)
    bath, lumen = joined(rng.uniform(0, most[0])), joined(rng.uniform(1, most[1]))
    return (*options, f"--bath={bath}", f"--lumen={lumen}")
