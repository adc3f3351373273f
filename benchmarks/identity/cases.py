"""Right and wrong registrations: each scan held against its own design and against another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from benchmarks.identity import designs, light, prints
from registration.alignment import AlignmentOptions
from registration.alignment.distance import ModelSurface
from registration.errors import RegistrationError
from registration.measuring.topology import Landed, agreement
from registration.options import RegistrationOptions
from registration.prepared import PreparedScan
from registration.register import align_prepared
from registration.segmentation import GelEvidence, gel_evidence

QUICK_SEARCH = AlignmentOptions(
    cover=600,
    descents=50,
    orientations=8,
    places=2,
    coarse_points=800,
    fine_points=5000,
    contest_points=10_000,
)
"""A twelfth of the usual search. A wrong part's best pose may be missed, which makes it a worse
fit than it is; of right parts all were landed on."""
OPTIONS = RegistrationOptions(working_voxel_mm=0.05, alignment=QUICK_SEARCH)


def case(number: int) -> dict[str, Any]:
    """Make a scan, hold it against both designs, and return what tells of its identity."""
    rng = np.random.default_rng([number, 89])
    generator = light.GENERATORS[number % len(light.GENERATORS)]
    damage = prints.DAMAGE[number // len(light.GENERATORS) % len(prints.DAMAGE)]
    how = designs.WRONG[number % len(designs.WRONG)]
    design = designs.draw(rng)
    scan = light.scan_of(prints.draw_print(design, damage, rng), generator, rng)
    told = {"case": number, "generator": generator, "damage": damage, "wrong": how}
    try:
        own = PreparedScan.of(scan, design.solid, design.network, OPTIONS)
        seen = own.segmentation
        evidence = gel_evidence(seen.field, seen.strength, scan.depth_down)
    except RegistrationError as error:
        return told | {"unread": str(error)}
    other = designs.wrong_for(design, how, rng)
    wrong = replace(own, surface=ModelSurface.of(other.solid), network=other.network)
    return told | {"of_right": _numbers(own, evidence), "of_wrong": _numbers(wrong, evidence)}


def _numbers(held: PreparedScan, evidence: GelEvidence) -> dict[str, Any]:
    """Find the pose; return the numbers of the agreement, or why there is none."""
    try:
        fit = align_prepared(held).scaled
    except RegistrationError as error:
        return {"refused": str(error)}
    landed = Landed(
        held.surface,
        held.network,
        held.segmentation,
        evidence,
        fit,
        held.is_lumen,
        held.scan.depth_down,
    )
    found = agreement(landed)
    return asdict(found) | {"other_part": found.other_part, "scale": fit.scale.tolist()}


def cases(numbers: range) -> Iterator[dict[str, Any]]:
    """Yield cases by number."""
    return map(case, numbers)
