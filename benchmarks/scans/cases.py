"""Scan cases of each benchmark family, drawn from a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

SHARED = {"block": 4, "tree": 7, "loop": 13}
SPECTRAL = {"curved": 8, "slanted": 4, "drum": 4, "compact": 4}
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


@dataclass(frozen=True)
class Case:
    """A scan to make and register.

    Attributes
    ----------
    generator : str
        "shared" or "spectral".
    design : str
    seed : int
    options : tuple of str
        Of the generator, but for the seed.
    register : tuple of str
        More options of `printctl register`.
    """

    generator: str
    design: str
    seed: int
    options: tuple[str, ...] = ()
    register: tuple[str, ...] = ()


def joined(*values: float) -> str:
    """Return numbers separated by commas, short."""
    return ",".join(f"{v:.4g}" for v in values)


def designs(generator: str) -> dict[str, int]:
    """Return a generator's designs for general use and their numbers of vessels."""
    return SHARED if generator == "shared" else SPECTRAL


def pick(generator: str, seed: int, rng: np.random.Generator) -> tuple[str, int]:
    """Return a design, each in turn, and one of its vessels."""
    names = sorted(designs(generator))
    name = names[seed % len(names)]
    return name, int(rng.integers(designs(generator)[name]))


def radius_mm(generator: str, design: str, vessel: int) -> float:
    """Return about the radius of a vessel; changes are given in mm to the generators."""
    known = {
        "block": (0.25, 0.35, 0.45, 0.2),
        "tree": (0.45, 0.36, 0.34, 0.28, 0.25, 0.26, 0.24),
        "loop": (0.28,) * 10 + (0.35, 0.3, 0.2),
        "curved": (0.43, 0.35, 0.33, 0.25, 0.25, 0.24, 0.22, 0.24),
        "slanted": (0.225, 0.35, 0.24, 0.25),
        "drum": (0.375, 0.25, 0.3, 0.2),
        "compact": (0.3, 0.225, 0.2, 0.18),
    }
    return known[design][vessel]


def changes(generator: str, seed: int) -> Case:
    """Return a change of 10 to 30 %, 0.2 to 3 mm or a vessel long; each fourth scan is clean."""
    rng = np.random.default_rng([seed, 1])
    design, vessel = pick(generator, seed // 2 if generator == "shared" else seed, rng)
    amount = rng.uniform(0.10, 0.30) * rng.choice([-1, 1]) * radius_mm(generator, design, vessel)
    kind = seed % 4
    if kind == 0:
        return Case(generator, design, seed)
    if kind == 1:
        return Case(generator, design, seed, ("--radius-change=" + joined(vessel, amount),))
    sigma = np.exp(rng.uniform(np.log(0.2), np.log(3.0))) / 4
    return Case(
        generator,
        design,
        seed,
        ("--bulge=" + joined(vessel, rng.uniform(0.35, 0.65), sigma, amount),),
    )


def poses(generator: str, seed: int) -> Case:
    """Return a part turned over, mirrored, half in view, symmetric, or on any of 24 sides."""
    rng = np.random.default_rng([seed, 2])
    names = sorted(designs(generator))
    design, kind = names[(seed // 6) % len(names)], seed % 6
    yaw = "--yaw=" + joined(rng.choice([0, 90, 180, 270]) + rng.uniform(-12, 12))
    if kind == 0:
        return Case(generator, design, seed, ("--turned-over", yaw))
    if kind == 1:
        return Case(generator, design, seed, ("--mirror", "xyz"[seed // 6 % 3]))
    if kind == 2:
        return Case(generator, design, seed, ("--half-field",))
    if kind == 3:
        return Case(generator, design, seed, (yaw,))
    if generator == "spectral" and kind == 4:
        names = ["half_turns", "quarter_turns", "mirrored_pair"]
        return Case(generator, names[seed // 6 % 3], seed, (yaw,))
    if generator == "spectral":
        return Case(generator, "compact", seed, ("--orientation", str(int(rng.integers(24))), yaw))
    return Case(
        generator,
        "symmetric" if kind == 4 else design,
        seed,
        (yaw, *(("--turned-over",) if kind == 5 else ())),
    )


def intervals(generator: str, seed: int) -> Case:
    """Return light and part over the whole range that intervals must hold in."""
    rng = np.random.default_rng([seed, 3])
    design, _ = pick(generator, seed, rng)
    options = [
        "--snr-db=" + joined(rng.uniform(20, 35)),
        "--index=" + joined(1.333 * rng.uniform(0.98, 1.02)),
        "--roughness-um=" + joined(rng.uniform(0, 40)),
    ]
    if seed % 2:
        options.append("--contrast=" + joined(np.exp(rng.uniform(np.log(1.2), np.log(50)))))
    else:
        options += ["--bath=" + joined(rng.uniform(0, 10)), "--lumen=" + joined(rng.uniform(1, 15))]
    return Case(generator, design, seed, tuple(options))


def ways(generator: str, seed: int) -> Case:
    """Return a leak, bridge, plug or missing vessel of at least 150 um."""
    rng = np.random.default_rng([seed, 4])
    design, vessel = pick(generator, seed // 4, rng)
    width, place = rng.uniform(0.15, WIDEST_MM), rng.uniform(0.35, 0.65)
    kind = ("leak", "bridge", "plug", "missing")[seed % 4]
    if kind == "leak":
        return Case(generator, design, seed, ("--leak=" + joined(vessel, place, width),))
    if kind == "bridge":
        one, other = BRIDGES[design]
        place = rng.uniform(*BRIDGED_AT)
        return Case(generator, design, seed, ("--leak=" + joined(one, place, width, other),))
    if kind == "plug":
        return Case(
            generator, design, seed, ("--plug=" + joined(vessel, place, rng.uniform(0.15, 0.8)),)
        )
    return Case(generator, design, seed, ("--missing", str(vessel)))


def diameters(generator: str, seed: int) -> Case:
    """Return clean parts, roughness to 30 um; of `spectral` one with fifteen vessels."""
    rng = np.random.default_rng([seed, 5])
    rough = "--roughness-um=" + joined(rng.uniform(0, 30))
    if generator == "spectral":
        return Case(generator, "fifteen", seed, (rough, "--yaw=" + joined(rng.uniform(-3, 3))))
    return Case(generator, sorted(SHARED)[seed % 3], seed, (rough,))


def faces(generator: str, seed: int) -> Case:
    """Return scans whose deep faces are dim."""
    rng = np.random.default_rng([seed, 6])
    design, _ = pick(generator, seed, rng)
    options = (
        "--snr-db=" + joined(rng.uniform(20, 28)),
        "--rolloff-db-mm=" + joined(rng.uniform(0.5, 3)),
        "--bath=" + joined(rng.uniform(0, 8)),
    )
    return Case(generator, design, seed, options)


def formats(generator: str, seed: int) -> Case:
    """Return stored forms (bits, dB, axes, depth), and faults of the instrument."""
    forms = {
        "shared": [
            ("--db",),
            ("--dtype", "uint16"),
            ("--dtype", "uint8"),
            ("--db", "--dtype", "uint16"),
            ("--db", "--dtype", "uint8"),
        ]
    }
    forms["spectral"] = [
        ("--axes", "yzx"),
        ("--axes", "yxz", "--db"),
        ("--depth-up",),
        ("--db", "--dtype", "uint8"),
        ("--dtype", "uint8", "--axes", "yzx"),
        ("--stripes", "0.3"),
        ("--saturation", "3"),
        ("--jitter-um", "15"),
        ("--looks", "4"),
        ("--gel-index", "1.345"),
    ]
    own = forms[generator]
    return Case(
        generator, "block" if generator == "shared" else "compact", seed, own[seed % len(own)]
    )


def time(generator: str, seed: int) -> Case:
    """Return one scan of 1000 x 500 x 250 voxels."""
    if generator == "spectral":
        return Case(
            generator,
            "curved",
            seed,
            ("--voxel-um", "12,18.5,16", "--field-mm", "11.99,9.24,3.99", "--yaw", "2"),
        )
    return Case(generator, "tree", seed, ("--voxel-um", "11,17.5,14", "--yaw", "2"))


FAMILIES: dict[str, Callable[[str, int], Case]] = {
    f.__name__: f for f in (changes, poses, intervals, ways, diameters, faces, formats, time)
}
