"""Flows of layers of the third painter: widths within their uncertainty, and what is decided.

Sound layers at five flows, each looked at once and decided on by an observer that mends unasked.
The painter's flow judges what a look reports: a flow that is off, neither corrected nor asked about
and outside the reported interval has passed silently.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.checkers.scene_painter import INKS, KINDS, Scene, scene
from benchmarks.common import Row, all_of, at_least, limited
from benchmarks.observe.scenes import lines_of, seen
from firmware_profiles.materials.bead import BeadSection
from printctl.observe.deciding import Decider, DecisionKind, Limits
from printctl.observe.looks.expected_ink import ExpectedInk, LayerInk
from printctl.observe.looks.look_evidence import build_evidence

FLOWS = (0.7, 0.85, 1.0, 1.15, 1.3)
FIRST = 600
LOOKED_AT = ("single", "embedded", "laser")
SPEED_MM_S = 4.0
SIGMAS = 2.0
"""Standard uncertainties, of widths and of flows."""


@dataclass(frozen=True)
class Judged:
    """One layer: its flow, by how many uncertainties its width is off, and the outcome."""

    flow: float
    off: float
    outcome: str


def ink_of(painted: Scene, kind: str) -> ExpectedInk:
    """Return the plan as written ink, in time at one speed."""
    lines, plan = lines_of(painted), painted.expected
    count, layered = len(lines), kind != "embedded"
    width = lines.width_mm
    height = np.full(count, plan["thickness_mm"]) if layered else width
    area = BeadSection().area(width, height) if layered else np.pi / 4 * width**2
    length = np.linalg.norm(lines.end - lines.start, axis=1)
    time_s = (np.cumsum(length) - 0.5 * length) / SPEED_MM_S
    return ExpectedInk(
        (), lines.start, lines.end, width, height, area, np.arange(count), lines.stroke, time_s,
        np.ones(count), "layered" if layered else "embedded", np.zeros(count, dtype=np.bool_),
    )  # fmt: skip


def judged(job: tuple[str, str, int, float]) -> Judged:
    """Paint a sound layer at a flow, look at it and decide."""
    kind, ink, seed, flow = job
    rng = np.random.default_rng((seed, KINDS.index(kind), INKS.index(ink)))
    painted = scene(kind, ink, rng, {"flow": flow})
    found = seen(painted, kind)
    written, lines = ink_of(painted, kind), lines_of(painted)
    evidence = build_evidence(
        LayerInk(lines, np.arange(len(lines))), written, found, None, section=BeadSection(),
        least_gap_mm=0.2, left_ul=None,
    )  # fmt: skip
    decider = Decider(Limits(mend="mend"))
    decision, reported = decider.decide(evidence), decider.control.last
    off = (found.width_ratio - painted.truth["width_ratio"]) / found.u_width_ratio
    if decision.factor is not None:
        outcome = "asked" if decision.kind is DecisionKind.PAUSE else "corrected"
    elif reported is None:
        outcome = "no flow reported"
    else:
        holds = abs(reported.level - np.log(flow)) < SIGMAS * reported.u
        outcome = "within the reported interval" if holds else "outside it"
    return Judged(flow, off, outcome)


def rows(quick: bool) -> Iterator[Row]:
    """Yield widths, flows that passed silently, and sound flows that were acted on."""
    seeds = range(FIRST, FIRST + (1 if quick else 4))
    jobs = [(k, i, s, f) for k in LOOKED_AT for i in INKS for s in seeds for f in FLOWS]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        each = list(pool.map(judged, jobs))
    off = np.array([one.off for one in each if np.isfinite(one.off)])
    within = float((np.abs(off) < SIGMAS).mean())
    yield at_least("widths within two uncertainties", within, f"of {len(off)} looks", 0.95)
    wrong = [one.outcome for one in each if one.flow != 1.0]
    silent = wrong.count("outside it")
    yield limited("flows 15 % off and more passed silently", silent, f"of {len(wrong)}", 0)
    acted = wrong.count("asked") + wrong.count("corrected")
    made = all_of("flows 15 % off and more corrected or asked about", acted, len(wrong))
    yield made | {"outcomes": Counter(wrong)}
    sound = [one.outcome for one in each if one.flow == 1.0]
    acted = sound.count("asked") + sound.count("corrected")
    made = limited("sound flows asked about or corrected", acted, f"of {len(sound)}", 0)
    yield made | {"outcomes": Counter(sound)}
