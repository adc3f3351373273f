"""Grow one tree to its number of terminals: add, check radii for collisions, repair; repeat."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError, NoRoomError, RootError
from design.vasculature.growth.checks import (
    measure_allowed_radii,
    measure_changed,
    prune,
    retip_thin,
)
from design.vasculature.growth.cost import place, refresh
from design.vasculature.growth.final_tree import final_radii, share_by_demand
from design.vasculature.growth.growth_state import ALL_AROUND, GrowthState, just_below
from design.vasculature.growth.index import (
    MARGIN,
    MARGIN_AT_MOST,
    MARGIN_LEFT,
    Clearances,
    clearances_of,
)
from design.vasculature.growth.kernel import (
    DONE,
    FULL_INDEX,
    MORE_POINTS,
    THIN_MARGIN,
    Scale,
    derive_radii,
    first_pair,
    grow,
)
from design.vasculature.growth.points import GivenPoints, Samples, obstructing_segments
from design.vasculature.growth.root import lengthen_stem, stem, stem_is_short
from design.vasculature.growth.start import sole_end
from design.vasculature.growth.trunk import Trunk
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from kernels.arrays import FloatArray

ROUNDS = 20
"""Audits and repairs at most."""
_PATIENCE = 20_000
_CHUNK = 4096
TRIES = 0.5
"""Points in the tissue sampled at a time, over the terminals there are: few enough that a tree
grown to them in order is like one grown in random order."""
_WAYS_MADE = 40
"""How often what is in the way of given points is taken away."""


class TreeGrowth(GrowthState):
    """The loop that has a tree grown, audited and repaired."""

    def run(self) -> VesselTree:
        """Grow, audit and repair until everything fits."""
        self.start()
        for _ in range(ROUNDS):
            self.grow()
            left = self.audit()
            if left == 0:
                return self.tree()
            self.repair()
        raise GrowthError(
            f"{left} of {self.count} vessels still collide or leave the tissue after {ROUNDS} "
            "repairs; ask for fewer terminals, a smaller smallest radius or clearance"
        )

    def start(self) -> None:
        """Plant the trunk, or place the stem and the first two terminals."""
        law = self.options.law
        if self.trunk is not None:
            self._plant(self.trunk)
            return
        settings = self._enter_stage()
        begin, end = stem(self.tissue, settings, self._first_guess(), self.room.wall)
        self.segments[0]["parent"] = self.segments[0]["left"] = self.segments[0]["right"] = -1
        place(self.segments, 0, tuple(begin), tuple(end))
        refresh(self.segments, 0, law)
        self.segments[0]["allowed"] = np.inf
        if self.others.count and not self._clear(begin, end[None], self._first_guess())[0]:
            raise GrowthError(
                "the root's stem from ({:.4g}, {:.4g}, {:.4g}) ".format(*begin)
                + "meets another tree's vessel; choose another place or direction of the root"
            )
        self.progress["count"], self.progress["terminals"] = 1, 1
        if self.options.terminals > 1:
            self._first_pair()
        else:
            end = self._sole_end(begin, end)
            place(self.segments, 0, tuple(begin), tuple(end))
            refresh(self.segments, 0, law)
        derive_radii(self.segments, self.progress, law, self.scale)

    def _sole_end(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """Where the one terminal ends: as given, else in the middle of what it supplies.

        A root direction that is given is kept.
        """
        radius = self._first_guess()
        samples = self._samples(_CHUNK).at
        middle = samples.mean(axis=0) if len(samples) else end
        if self.given is not None:
            ends = samples
        elif self.options.root_direction is not None:
            ends = begin + np.linspace(1.0, self._far(begin, end), _CHUNK)[:, None] * (end - begin)
        else:
            ends = np.concatenate([samples, end[None]])
        if self.others.count:
            ends = ends[self._clear(begin, ends, radius)]
        return sole_end(self.tissue, begin, ends, middle, radius + self.room.wall)

    def _far(self, begin: FloatArray, end: FloatArray) -> float:
        """Factor by which the stem is as long as the tissue."""
        across = float(np.linalg.norm(np.ptp(self.tissue.bounds, axis=0)))
        return max(1.0, across / float(np.linalg.norm(end - begin)))

    def _plant(self, trunk: Trunk) -> None:
        trunk.plant(self.segments, self.options.law)
        self.progress["count"], self.progress["terminals"] = len(trunk.parent), trunk.tips
        derive_radii(self.segments, self.progress, self.options.law, self.scale)

    def _first_pair(self) -> None:
        law, root = self.options.law, self._first_guess()
        apart = 0.5 * float(np.cbrt(self.scale.volume))
        at = np.array([self.segments[name][0] for name in ("dx", "dy", "dz")])
        for _ in range(40):
            samples = self._samples(_CHUNK)
            if self.others.count:
                clear = self._clear(at, samples.at, root)
                samples = Samples(*(column[clear] for column in samples))
            if first_pair(self.segments, self.room, law, root, samples, apart):
                self.progress["count"], self.progress["terminals"] = 3, 2
                self.segments["allowed"][:3] = np.inf
                return
            apart *= 0.85
        raise RootError(
            "no two branches fit at the end of the root's stem; choose another place or "
            "direction of the root, fewer terminals, a smaller smallest radius or clearance"
        )

    def _first_guess(self) -> float:
        """Root radius before there is a tree, mm: that of a pipe twice as long as the tissue."""
        if self.scale.root_radius > 0:
            return self.scale.root_radius
        load = 2.0 * self.options.law.k * float(np.cbrt(self.tissue.volume_mm3))
        return float((self.scale.flow_over_drop * load) ** 0.25)

    def grow(self, until: int | None = None) -> None:
        """Grow up to the goal, wherever growth stands, or to so many terminals on the way."""
        goal = min(until or self.goal, self.goal)
        while self.terminals < goal:
            self._enter_stage()
            stages = self.options.stages
            self.grow_to(min(goal, stages[self.stage].terminals) if stages else goal)

    def grow_to(self, goal: int) -> None:
        """Grow to so many terminals with the parameters of now."""
        self.progress["since"] = 0
        samples, first = self.sampler.none(), 0
        status = FULL_INDEX
        while status != DONE and self.terminals < goal:
            if status == MORE_POINTS:
                samples, first = self._more(), 0
            else:
                self._pause(status)
            status, first = grow(
                self.segments,
                self.index,
                self.room._replace(reserve=self._reserve(), widest_branch=self._widest_branch()),
                self.options.law,
                self.scale,
                self.penalty,
                self.progress,
                samples,
                first,
                min(self._pause_at(), goal),
            )
            # Points in the order of a curve fail together: a whole lot of them must.
            stuck = self.progress["since"][0] > max(_PATIENCE, len(samples.at))
            if stuck and self.terminals < self.narrow_until:
                self.narrow_until, status = 0, FULL_INDEX
                self.progress["since"] = 0
            elif stuck and self.given is None:
                begun = self.trunk.tips if self.trunk else 0
                raise out_of_room_error(
                    self.terminals, self.options, self.scale, self.room, _PATIENCE, begun
                )

    def _pause_at(self) -> int:
        """Terminals at which growth pauses, unless the index is full before."""
        double, wide = 2 * self.indexed, self.narrow_until
        return min(double, wide) if self.terminals < wide else double

    def _pause(self, status: int) -> None:
        """What is due before growth goes on."""
        self._relist()

    def _relist(self) -> None:
        """List everything anew, and measure the room that each segment has."""
        self._reindex()
        self._measure()
        derive_radii(self.segments, self.progress, self.options.law, self.scale)

    def _measure(self) -> None:
        """Measure the room that each segment has, as far as it may have changed."""
        # By the limits of the audit: those that a later stage sets for its own joints would close
        # the earlier ones'.
        room = clearances_of(self.tissue, self.options.mildest())
        room = room._replace(widest_branch=self._widest_branch())
        if self.progress["careful"][0]:
            # The audit has measured all but what was pruned since.
            measure_changed(self.segments, self.count, self.index, room, 0.0, True)
        else:
            # Neighbours' shares have changed since each segment's room was measured.
            measure_allowed_radii(self.segments, self.count, self.index, room, 0.0, False)

    def _more(self) -> Samples:
        """More points to grow to."""
        if self.given is None:
            return self._samples(self._tries())
        missing = self._missing(self.given)
        if len(missing) == self.unreached:
            # A whole pass reached none of them.
            return self._made_way(self.given, missing)
        self.unreached = len(missing)
        return self.given.samples(self.random.permutation(missing))

    def _tries(self) -> int:
        """Points to draw at a time."""
        tries = TRIES * self._per_wanted * self.terminals
        return int(np.clip(tries, _CHUNK, 1 << 21))

    def _made_way(self, given: GivenPoints, missing: NDArray[np.int64]) -> Samples:
        """Take away what lies nearest to points that can't be reached, and put these first."""
        passes = given.stuck_on(missing)
        self.progress["candidates"] = ALL_AROUND
        if passes > _WAYS_MADE:
            raise given.unreached(missing, self.tissue)
        s = self.segments[: self.count]
        s["allowed"] = np.inf
        s["allowed"][obstructing_segments(s, given.at[missing], 1 + passes // 5)] = 0.0
        self._reindex()
        try:
            self._prune()
        except GrowthError as error:
            raise given.unreached(missing, self.tissue) from error
        self._relist()
        freed = np.setdiff1d(self._missing(given), missing)
        self.unreached = len(missing) + len(freed)
        order = [self.random.permutation(some) for some in (missing, freed)]
        return given.samples(np.concatenate(order))

    def _widest_branch(self) -> float:
        """Radius, over the root's, at which a branch takes on no more terminals now."""
        early = self.terminals < self.narrow_until
        return self.trunk.widest_branch if self.trunk is not None and early else np.inf

    def _reserve(self) -> float:
        """How much wider than predicted trial forks must be able to grow."""
        if self.scale.root_radius > 0:
            return MARGIN
        left = float(np.log(self.goal / self.terminals))
        return min(MARGIN + MARGIN_LEFT * left, MARGIN_AT_MOST)

    def audit(self) -> int:
        """Derive the final radii; return how many segments don't fit with them.

        With a smallest radius, a thinner terminal doesn't fit either; nor does a stem too short
        for its radius, nor a joint that breaks the limits.
        """
        smallest = self.options.smallest_radius_mm
        self.room = clearances_of(self.tissue, self.options.mildest())
        if self.sampler.flows:
            share_by_demand(self.segments, self.count, self.tissue, self.options, self.others.owns)
        final_radii(self.segments, self.count, self.options, self.scale)
        self._reindex()
        least = just_below(smallest or 0.0)
        return self._too_wide(least) + self._stem_is_short()

    def _too_wide(self, least: float) -> int:
        """How many segments the final audit finds wider than allowed."""
        index, room = self.index, self.room
        return int(measure_allowed_radii(self.segments, self.count, index, room, least, True))

    def _stem_is_short(self) -> bool:
        return self.trunk is None and stem_is_short(self.segments, self.room)

    def repair(self) -> None:
        """Lengthen the stem, or move tips that are too thin and take away what else doesn't fit."""
        self.progress["careful"] = 1
        if self._stem_is_short():
            lengthen_stem(self.segments, self.room, self.options.law)
            return
        if self.options.smallest_radius_mm is not None and self.given is None:
            retip_thin(
                self.segments,
                self.count,
                self.index,
                self.room,
                self.options.law,
                self._samples(_CHUNK).at,
                THIN_MARGIN * self.options.smallest_radius_mm,
            )
        self._prune()

    def _prune(self) -> None:
        """Take away what is wider than allowed."""
        least = THIN_MARGIN * (self.options.smallest_radius_mm or 0.0)
        if self.given is not None:
            least = np.inf  # a given terminal stays where it is
        law = self.options.law
        left = prune(self.segments, self.count, self.index, self.room, law, least)
        if left == 1 and self.trunk is None:
            raise RootError(
                "the branches at the root don't fit with their final radii; choose another "
                "place of the root, fewer terminals, a smaller smallest radius or clearance"
            )
        self.progress["count"] = left
        self.progress["terminals"] = self.segments["terminals"][0]
        self.progress["apart"] = 0.9
        derive_radii(self.segments, self.progress, self.options.law, self.scale)


def out_of_room_error(
    terminals: int,
    options: GrowthOptions,
    scale: Scale,
    room: Clearances,
    patience: int,
    begun: int = 0,
) -> NoRoomError:
    """The error that says how many terminals fit, and what might help; a trunk had ``begun``."""
    smallest = options.smallest_radius_mm
    wide = f" of radius {smallest:g} mm or more" if smallest else ""
    asked, root = scale.goal, scale.root_radius
    reserved = (
        f" beside a trunk from {root:.3g} mm radius, reserved because {asked} terminals need it"
    )
    limits = ", milder limits on angles or flows" if room.limits.on else ""
    hint = " (their thinner trunk leaves more room: more than here may then fit)"
    # Without a smallest radius all radii follow from the drop, and fewer terminals have as wide
    # a trunk.
    narrower = "a smaller smallest radius" if smallest else "a higher pressure drop"
    return NoRoomError(
        f"only {terminals} of {asked} terminals{wide} fit with clearance "
        f"{room.clearance:g} mm{reserved if root else ''}: {patience} points in a "
        "row found no place",
        f"ask for {narrower} (narrower vessels), fewer "
        f"terminals{hint if root else ''} or a smaller clearance{limits}",
        placed=terminals - begun,
    )
