"""Convert ordered writing strokes to toolpath moves: end overlaps, lowest safe travels."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from design.toolpath.embedded.elements import (
    TAPER_STEP,
    Elements,
    at_places,
    finer_places,
    nearest_along,
    off_chords,
)
from design.toolpath.embedded.filament import frustum_ul, writing_speed
from design.toolpath.embedded.ink_heights import Ground, ground_under, highest_along, lay
from design.toolpath.embedded.joined import JoinedPasses
from design.toolpath.embedded.schedule import Pass
from design.toolpath.embedded.vessel_heads import EmbeddedHeads
from design.toolpath.embedded.walk import Leg
from design.toolpath.moves import MoveBuilder
from kernels.arrays import FloatArray, IntArray

STEP = 1.5
"""Where a pass goes on into a vessel by so much thinner or thicker, the plunger relieves and primes
in place: the pressure that drives a thick filament takes its way to fall, and would swell the thin
one behind it. A smaller step swells the first half millimetre by 27 % at most
(`sim.gcode.deposit.lay`)."""

ROUNDING_MM = 1e-6
"""What ends so near to a vessel's end ends there."""


@dataclass(frozen=True)
class Stretch:
    """Part of one vessel as it is written: points (k, 3), radii and way along it (k,), mm."""

    points: FloatArray
    radius: FloatArray
    along: FloatArray
    vessel: int


class FilamentWriter:
    """Converts embedded passes to moves.

    Parameters
    ----------
    elements : Elements
    first : Pass
    heads : EmbeddedHeads
    known : dict of Leg to Stretch, or None
        Stretches of a writing before; those of this one are added.
    looks : set of int
        Elements before which the path names a place to look.

    Attributes
    ----------
    builder : MoveBuilder
        Where the moves go.
    overlap_ul : float, µL
        Ink of the overlaps.
    """

    def __init__(
        self,
        elements: Elements,
        first: Pass,
        heads: EmbeddedHeads,
        known: dict[Leg, Stretch] | None = None,
        looks: Set[int] = frozenset(),
    ) -> None:
        self._looks = looks
        self._known = {} if known is None else known
        self._elements, self._heads = elements, heads
        leg = first.legs[0]
        self._head = heads.of(int(elements.vessel[leg.element]))
        self._options = heads.options[self._head]
        start = elements.point[elements.end[leg.element, 0 if leg.step > 0 else 1]]
        self.builder = MoveBuilder(start, "vessel")
        self.builder.tool = self._head
        self.overlap_ul = 0.0
        self._vessels: list[int] = []
        self._along: list[FloatArray] = []
        self._radius: list[FloatArray] = []
        self._pressed: set[int] = set()
        self._started = False
        self._ground: Ground = ground_under(
            elements.point, heads.shaft_mm, float(elements.radius.max())
        )

    def write_all(self, passes: list[Pass], joined: JoinedPasses) -> None:
        """Write passes in their order."""
        for one, before, beyond in zip(passes, joined.before, joined.beyond, strict=True):
            parts = [part for leg in one.legs for part in self._parts(leg)]
            looks = {k for k, part in enumerate(parts) if part.element in self._looks}
            stretches = [self._stretch(part) for part in parts]
            self._write(stretches, float(before), float(beyond), looks)

    def laid(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Vessel (w,), way along it and radius at both ends (w, 2), of each move that writes."""
        counts = [len(one) for one in self._along]
        vessel = np.repeat(np.array(self._vessels, dtype=np.int64), counts)
        return vessel, np.concatenate(self._along), np.concatenate(self._radius)

    def _parts(self, leg: Leg) -> list[Leg]:
        """A leg cut where the path names a place to look."""
        cuts = [k for k, one in enumerate(leg.elements().tolist()) if k and one in self._looks]
        return [
            Leg(leg.element + leg.step * low, leg.step, high - low)
            for low, high in pairwise([0, *cuts, leg.size])
        ]

    def _stretch(self, leg: Leg) -> Stretch:
        """A leg as few straight moves as its shape and taper need."""
        if leg not in self._known:
            self._known[leg] = self._new_stretch(leg)
        return self._known[leg]

    def _new_stretch(self, leg: Leg) -> Stretch:
        order = leg.elements()
        side = (0, 1) if leg.step > 0 else (1, 0)
        ends, radius = self._elements.end[order], self._elements.radius[order]
        numbers = np.append(ends[:, side[0]], ends[-1, side[1]])
        thick = np.append(radius[:, side[0]], radius[-1, side[1]])
        way = self._elements.along[order]
        along = np.append(way[:, side[0]], way[-1, side[1]])
        points = self._elements.point[numbers]
        keep = off_chords(points, thick)
        points, thick, along = points[keep], thick[keep], along[keep]
        place = finer_places(points, thick, np.inf, TAPER_STEP)
        points, thick, along = (at_places(each, place) for each in (points, thick, along))
        return Stretch(points, thick, along, int(self._elements.vessel[leg.element]))

    def _write(
        self, stretches: list[Stretch], before: float, beyond: float, looks: Set[int]
    ) -> None:
        if before > 0.0:
            stretches[0] = self._longer(stretches[0], before, at_end=False)
        if beyond > 0.0:
            stretches[-1] = self._longer(stretches[-1], beyond, at_end=True)
        first = stretches[0]
        self._go(first.points[0], first.vessel, self._heads.of(first.vessel))
        for number, one in enumerate(stretches):
            if number in looks:
                self.builder.look(one.vessel)
            if number and _is_step(stretches[number - 1], one):
                self._settle(one.vessel)
            length = np.linalg.norm(np.diff(one.points, axis=0), axis=1)
            volume = frustum_ul(one.points, one.radius)
            speed = writing_speed(volume / length, self._options)
            self.builder.write(one.points[1:], volume, speed, one.vessel)
            self._vessels.append(one.vessel)
            self._along.append(np.column_stack([one.along[:-1], one.along[1:]]))
            self._radius.append(np.column_stack([one.radius[:-1], one.radius[1:]]))
            lay(self._ground, one.points, one.radius, self._heads.shaft_mm)
        self._pressed.add(self._head)

    def _settle(self, vessel: int) -> None:
        """Relieve the plunger, and prime it again, without leaving the place."""
        options = self._options
        self.builder.plunge(-options.retract_ul, options.plunger_ul_s, vessel)
        self.builder.plunge(options.retract_ul, options.plunger_ul_s, vessel)
        self.builder.dwell(options.dwell_s, vessel)

    def _longer(self, one: Stretch, reach_mm: float, *, at_end: bool) -> Stretch:
        """Go on straight beyond an end, as thick as there.

        Beyond the vessel's own end the way counts on. Where the pass was cut within the vessel it
        is that of what is nearest on the axis, from which a bend leads away.
        """
        end, inner = (-1, -2) if at_end else (0, 1)
        way = one.points[end] - one.points[inner]
        further = one.points[end] + reach_mm * way / np.linalg.norm(way)
        place = len(one.points) if at_end else 0
        rises = one.along[end] > one.along[inner]
        along = one.along[end] + (reach_mm if rises else -reach_mm)
        whole = self._elements.along[self._elements.first[one.vessel + 1] - 1, 1]
        if ROUNDING_MM < one.along[end] < whole - ROUNDING_MM:
            along = nearest_along(self._elements, one.vessel, further)
        self.overlap_ul += float(np.pi * one.radius[end] ** 2 * reach_mm)
        return Stretch(
            np.insert(one.points, place, further, axis=0),
            np.insert(one.radius, place, one.radius[end]),
            np.insert(one.along, place, along),
            one.vessel,
        )

    def _go(self, to: FloatArray, vessel: int, head: int) -> None:
        """Retract, rise above what stands in the way, cross, go down, prime.

        With another head from the way across on; one that has pushed nothing yet isn't primed.
        Close to ink the needle goes slowly up and down, elsewhere as fast as across.
        """
        options, builder = self._options, self.builder
        if self._started:
            builder.plunge(-options.retract_ul, options.plunger_ul_s, vessel)
            tip, changes = builder.tip, head != self._head
            below = float(self._ground.top.max()) if changes else self._highest(tip, to)
            height = max(below, tip[2], to[2]) + options.lift_mm
            up, across = np.array([*tip[:2], height]), np.array([*to[:2], height])
            self._vertically(tip, up, vessel)
            self._head = builder.tool = head
            options = self._options = self._heads.options[head]
            if np.any(across != up):
                builder.travel(across[None], options.travel_speed_mm_s, vessel)
            self._vertically(across, to, vessel)
            if head in self._pressed:
                builder.plunge(options.retract_ul, options.plunger_ul_s, vessel)
        else:
            # The job begins here: before the first point, where an overlap asks for it.
            builder = self.builder = MoveBuilder(to, "vessel")
            builder.tool = self._head
        self._started = True
        builder.dwell(options.dwell_s, vessel)

    def _highest(self, tip: FloatArray, to: FloatArray) -> float:
        return float(highest_along(self._ground, tip, to))

    def _vertically(self, start: FloatArray, end: FloatArray, vessel: int) -> None:
        """Up or down: slowly below the ink that stands around, and a lift above it."""
        options = self._options
        low, high = sorted((float(start[2]), float(end[2])))
        slow = max(self._highest(start, start), low) + options.lift_mm
        fast_speed = max(options.travel_speed_mm_s, options.lift_speed_mm_s)
        if low < slow < high:
            between = np.array([*start[:2], slow])
            up = end[2] > start[2]
            speeds = [options.lift_speed_mm_s, fast_speed] if up else [
                fast_speed, options.lift_speed_mm_s,
            ]  # fmt: skip
            self.builder.travel(np.stack([between, end]), speeds, vessel)
        elif np.any(start != end):
            speed = options.lift_speed_mm_s if slow >= high else fast_speed
            self.builder.travel(end[None], speed, vessel)


def _is_step(one: Stretch, other: Stretch) -> bool:
    thin, thick = sorted((float(one.radius[-1]), float(other.radius[0])))
    return thick > STEP * thin
