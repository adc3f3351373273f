"""Compare pictures of a held print with the ink expected from its G-code; plan the mend."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from shapely import MultiPoint, Polygon, unary_union
from shapely.geometry.base import BaseGeometry

from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from firmware_profiles import Ink, Needle, Printer, Syringe, load
from kernels.arrays import FloatArray
from printctl.machine.job.job import Job, load_job
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import read_journal
from printctl.observe.deciding.evidence import Thin
from printctl.observe.devices import DeviceError, Place, Region
from printctl.observe.expected import ExpectedInk, expected_ink
from printctl.observe.held_look import (
    HeldLook,
    gaps_to_mend,
    learned_appearance,
    slab,
    unseen_stretches,
)
from printctl.observe.judging import (
    evidence_of,
    figures,
    ink_to_judge,
    narrowed_lumens,
    nothing_seen,
    without_rest,
)
from printctl.observe.last_map import LastMap
from printctl.observe.learned import Learned
from printctl.observe.look_values import Judged, Look, MendLines
from printctl.observe.mending import HeldPrint, Voids, checked_mend
from printctl.observe.mends_again import (
    MOST_TRIES,
    Mended,
    last_mends,
    left_in_vain,
    of_mends,
    tries_of,
    unseen_words,
    with_mends,
    writes_since,
)
from printctl.observe.order import ObserverOrder
from printctl.observe.records import DRAWN, read_looks
from printctl.observe.view_before import image_before
from printctl.observe.views import frame_holds, open_view, refuse_other_height
from registration.errors import PictureError
from registration.inspection import (
    Gap,
    LayerFindings,
    Lumen,
    SeeingOptions,
    annotated,
    better_turned,
    see_layer,
)

# Sections of a network's lumens at the height of a layer: areas where no ink may be.

_STEP: Final = 0.25
"""Distance of the spheres that a tube is made of, in radii."""
_ROUND: Final = 24
"""Corners of a circle."""


def lumens_at(network: VesselNetwork, z_mm: float, least_mm: float) -> tuple[Lumen, ...]:
    """Return the sections of all vessels at one height; narrower ones than ``least_mm`` left out.

    Parameters
    ----------
    network : VesselNetwork
        In the printer's frame.
    z_mm : float, mm
        Middle of the layer.
    least_mm : float, mm
    """
    lumens = []
    for vessel, (points, radius) in enumerate(network.polylines()):
        near = np.abs(points[:, 2] - z_mm) - radius
        if near.min() > np.ptp(points[:, 2]):
            continue
        middle, half = _discs(points, radius, z_mm)
        for area, width in _areas(middle, half):
            if width >= least_mm:
                outline = np.asarray(area.exterior.coords)[:-1]
                level = np.full((len(outline), 1), z_mm)
                lumens.append(Lumen(str(vessel), np.hstack([outline, level]), width))
    return tuple(lumens)


def _discs(points: FloatArray, radius: FloatArray, z_mm: float) -> tuple[FloatArray, FloatArray]:
    """Centres (k, 2) and radii of the spheres' sections along a polyline; 0 where they miss."""
    way = arc_lengths(points)
    count = max(int(np.ceil(way[-1] / (_STEP * float(radius.min())))) + 1, 2)
    at = np.linspace(0.0, way[-1], count)
    place = places_along(points, way, at)
    wide = np.interp(at, way, radius)
    half = np.sqrt(np.maximum(wide**2 - (place[:, 2] - z_mm) ** 2, 0.0))
    return place[:, :2], half


def _areas(middle: FloatArray, half: FloatArray) -> list[tuple[Polygon, float]]:
    """Connected areas of the discs that there are, each with its typical width."""
    inside = half > 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    areas = []
    for first, last in edges.reshape(-1, 2).tolist():
        area = _swept(middle[first:last], half[first:last])
        width = 2.0 * float(np.median(half[first:last]))
        areas += [(part, width) for part in _polygons(area)]
    return areas


def _swept(middle: FloatArray, half: FloatArray) -> BaseGeometry:
    angle = np.linspace(0.0, 2 * np.pi, _ROUND, endpoint=False)
    round_unit = np.column_stack([np.cos(angle), np.sin(angle)])
    rims = middle[:, None, :] + half[:, None, None] * round_unit
    pairs = [rims[:1]] if len(rims) == 1 else list(np.stack([rims[:-1], rims[1:]], axis=1))
    return unary_union([MultiPoint(one.reshape(-1, 2)).convex_hull for one in pairs])


def _polygons(area: BaseGeometry) -> list[Polygon]:
    parts = getattr(area, "geoms", [area])
    return [part for part in parts if isinstance(part, Polygon) and not part.is_empty]


log = logging.getLogger(__name__)
Image = NDArray[Any]
_ASIDE_MM: Final = 1.5
"""Blobs are looked for within 1.2 mm of a line."""
_ABOVE_MM: Final = 0.3
_BELOW: Final = 8.0
"""Layers below the middle of the one looked at: what shines through a gap is one layer lower."""


@dataclass
class ObservedJob:
    """A job as it stands at a look, and how its layers are seen.

    Attributes
    ----------
    folder : Path
        The print's.
    order : ObserverOrder
    begun : float, s since 1970
        Of the print: earlier pictures in the folder are another print's.
    """

    folder: Path
    order: ObserverOrder
    begun: float = 0.0
    _learned: Learned | None = None  # None until the records of another observer were read
    _digest: bytes = b""  # of what was taken last
    _last: HeldLook | None = None
    _map: LastMap = field(default_factory=LastMap)

    @cached_property
    def network(self) -> VesselNetwork | None:
        """Designed lumens, printer's frame; None where nobody said."""
        if not self.order.network:
            return None
        return read_network_csv(Path(self.order.network), "mm").moved(np.array(self.order.place_mm))

    @cached_property
    def _printer(self) -> Printer:
        return load(Printer, self.order.profile)

    @cached_property
    def _poured(self) -> tuple[Syringe, Ink, Needle]:
        order = self.order
        return load(Syringe, order.syringe), load(Ink, order.ink), load(Needle, order.needle)

    @cached_property
    def _job(self) -> Job:
        return load_job(Path(self.order.job), self._printer)

    def load(self) -> None:
        """Read job, profiles and network, so that what is wrong with them is told at once.

        Raises
        ------
        ProfileError, LinkError, DesignError, OSError
        """
        _ = self._job, self._poured, self.network

    def _held(self, look: Look) -> HeldLook:
        """The print as it is held, with all that was put into its job so far."""
        if self._last is None or self._last.look.number != look.number:
            inserts = read_journal(self.folder / JOURNAL).inserts
            job = self._job.grown_by([one for one in inserts if one.after < look.done])
            held = HeldPrint(
                job.lines,
                look.done,
                self._printer,
                *self._poured,
                "embedded" if self.order.embedded else "layered",
            )
            ink = expected_ink(held, job)
            mended, before = last_mends(read_looks(self.folder, self.begun), look)
            alone = bool(mended) and not writes_since(ink, look)
            judged = replace(look, before=before) if alone else look
            layer = ink_to_judge(ink, judged.before, look.done)
            layer = with_mends(layer, ink, mended, look.before)
            since = ink.command[layer.row] >= judged.before
            lumens = self._lumens(ink, judged)
            self._last = HeldLook(
                judged, held, job.flow, ink, layer, lumens, since, job.marks,
                mends_alone=alone and bool(layer.mended),
            )  # fmt: skip
        return self._last

    def region(self, look: Look) -> Region:
        """Return the box of the printer's frame that a look needs to see, mm.

        Up to above all ink, down to some layers below the ones looked at (in a bath to below the
        lowest filament), and as far aside as ink is looked for beside lines.
        """
        at = self._held(look)
        lines, (middle, thick) = at.layer.lines, slab(at)
        ends = np.concatenate([lines.start, lines.end])
        if not len(ends):
            ends = at.ink.end
        below = _BELOW * thick if at.ink.style == "layered" else thick / 2 + _ABOVE_MM
        low = np.append(ends[:, :2].min(axis=0) - _ASIDE_MM, middle - below)
        top = max(float(at.ink.end[:, 2].max()), middle + thick / 2)
        high = np.append(ends[:, :2].max(axis=0) + _ASIDE_MM, top + _ABOVE_MM)
        return _place(low), _place(high)

    @property
    def _known(self) -> Learned:
        return self._learned or Learned()

    # --- judging ---------------------------------------------------------------------------------

    def judge(self, look: Look, picture: Path, again: Path | None) -> Judged:
        """Judge one or two pictures.

        Raises
        ------
        DeviceError
            When a picture can't be read, or is the last one to the last bit.
        """
        at = self._held(look)
        if self._learned is None:
            self._learned = Learned.before(read_looks(self.folder, self.begun), look.number)
        judged = self._judged(at, picture, again)
        return replace(judged, learned=self._learned.state())

    def _judged(self, at: HeldLook, picture: Path, again: Path | None) -> Judged:
        if again is None:  # a first picture, or one that was taken anew
            at.found.clear()
        try:
            first = self._findings(at, picture)
        except PictureError as exc:
            nothing = replace(nothing_seen(), turned=at.turned)
            none = {"seen_share": 0.0, "not_seen": str(exc), "about_from": at.look.before}
            return Judged(nothing, none, at.flow)
        second = None if again is None else self._findings(at, again)
        if at.mends_alone:
            first, second = of_mends(first), None if second is None else of_mends(second)
        limits = self.order.limits
        each = [one for one in (first, second) if one is not None]
        evidence = evidence_of(
            at.layer,
            at.ink,
            first,
            second,
            section=at.held.ink.bead_section,
            least_gap_mm=limits.gap.least_mm,
            left_ul=self._left_ul(at.ink),
            unseen=unseen_stretches(at, each, limits.gap.least_mm),
            tolerated=limits.width_percent / 100,
        )
        evidence = replace(evidence, turned=at.turned, map=at.map)
        if at.mends_alone:  # of the rest the last look has told
            evidence = without_rest(evidence)
        found = {**figures(first, evidence), "about_from": at.look.before}
        if at.size and first.seen_share < self.order.limits.least_seen:
            found["not_seen"] = self._known.size_words(at.size)
        elif at.size:
            self._learned = self._known.with_size(at.size)
        if words := unseen_words(first, at.layer.mended):
            found["not_seen"] = words
        return Judged(evidence, found, at.flow)

    def _findings(self, at: HeldLook, path: Path) -> LayerFindings:
        """Findings of a picture; of the first one a drawing is left beside it."""
        if path not in at.found:
            slab_mm = slab(at)
            view = open_view(path, self.order, *slab_mm, at.layer.lines)
            image, frame, at.size = view.image, view.frame, view.size
            before = self._before(at, path, image)
            self._check_new(view.taken, before)
            layered = at.ink.style == "layered"
            is_height = self.order.tells_heights and layered
            at.map = at.map.worse(self._map.check(at, view))
            if self.order.tells_heights:  # a camera's marks hold its frame themselves
                laser = view.hidden is not None
                at.turned = better_turned(image, frame, at.layer.lines, view.scan, in_parts=laser)
            if is_height and not at.map.lacks:
                image = self._map.judged(at, view)
            image = image if view.filaments is None else view.filaments
            shown = view.shown_lines(at.layer.lines)
            findings = see_layer(
                image,
                frame,
                shown.lines,
                lumens=at.lumens,
                before=before,
                stood_still=partial(frame_holds, before, frame),
                since=at.since[shown.row],
                hidden=() if view.hidden is None else view.hidden,
                # In a bath ink is as dark as it is thick and near: each look learns its own.
                known=self._known.appearance if layered else None,
                thickness_mm=slab_mm[1] if is_height else None,
                options=self._options(),
            )
            findings = shown.as_given(findings)
            refuse_other_height(at.size, findings.seen_share, findings.coverage)
            if not at.found:
                known, least = self._known, self.order.limits.least_seen
                look = learned_appearance(known.appearance, findings, least)
                self._learned = replace(known, appearance=look)
                least = self.order.limits.least_open
                narrowed = narrowed_lumens(at.lumens, findings.lumens, least)
                drawn = annotated(view.drawn_into, frame, findings, narrowed)
                cv2.imwrite(str(path.with_name(DRAWN)), drawn)
            at.found[path] = findings
        return at.found[path]

    def _before(self, at: HeldLook, path: Path, image: Image) -> Image | None:
        """Picture of the look before, where it is a camera's of the same view."""
        if self.order.tells_heights:
            return None
        return image_before(self.folder, self.begun, at.look, path, image)

    def _check_new(self, taken: Image, before: Image | None) -> None:
        """Raise `DeviceError` for the very picture or volume taken last, or the one before."""
        kind = self.order.device.kind
        digest = blake2b(np.ascontiguousarray(taken).data).digest()
        again = digest == self._digest or (before is not None and np.array_equal(before, taken))
        if again and kind != "simulated":  # no sensor sees twice the same; a simulated one may
            raise DeviceError(
                f"the {kind} gave the last picture once more, to the last bit: it hangs; restart "
                "it, then resume"
            )
        self._digest = digest

    def _options(self) -> SeeingOptions:
        limits = self.order.limits
        return SeeingOptions(
            gap_mm=limits.gap.least_mm,
            width_percent=limits.width_percent,
            shift_mm=max(0.5, 2 * limits.shift_mm),
            round_lines=self.order.embedded and not self.order.oct,
        )

    def _lumens(self, ink: ExpectedInk, look: Look) -> tuple[Lumen, ...]:
        """Lumens in the topmost layer; an embedded print writes its vessels."""
        fresh = ink.between(look.before, look.done)
        if self.network is None or ink.style == "embedded" or not fresh.any():
            return ()
        top = int(np.flatnonzero(fresh)[ink.end[fresh, 2].argmax()])
        middle = float(ink.end[top, 2] - ink.height_mm[top] / 2)
        return lumens_at(self.network, middle, float(np.median(ink.width_mm[fresh])) / 2)

    def _left_ul(self, ink: ExpectedInk) -> float | None:
        if self.order.capacity_ul is None:
            return None
        length = np.linalg.norm(ink.end - ink.start, axis=1)
        left = self.order.capacity_ul - float((ink.area_mm2 * length * ink.factor).sum())
        return left if left >= 0 else None  # another syringe was put in

    # --- mending ---------------------------------------------------------------------------------

    def mend_lines(
        self,
        look: Look,
        gaps: tuple[Gap, ...],
        thin: tuple[Thin, ...],
        flow: float,
        approved: bool = False,
    ) -> MendLines:
        """Plan what mends gaps and fills thin lines up, and say what can't be from here.

        Parameters
        ----------
        look : Look
        gaps : tuple of Gap
        thin : tuple of Thin
        flow : float
            Ink that is to be pushed, over what the job's file says.
        approved : bool
            By the operator: what was written in vain before is written once more, too.
        """
        at = self._held(look)
        voids = None
        if self.network is not None:
            voids = Voids.of_network(self.network, np.zeros(3))
        wanted = gaps_to_mend(gaps, thin, at, flow)
        in_vain = [one for one in wanted if tries_of(one, at.layer.mended) >= MOST_TRIES]
        given_up = [] if approved else in_vain
        wanted = [one for one in wanted if one not in given_up]
        mend, _ = checked_mend(at.held, wanted, voids)
        mend = replace(mend, left=(*mend.left, *(left_in_vain(one) for one in given_up)))
        mended = tuple(
            Mended(
                one.gap.path,
                float(one.gap.from_mm),
                float(one.gap.to_mm),
                tries_of(one.gap, at.layer.mended) + 1,
            )
            for one in mend.patches
            if one.gap.whole
        )
        for said in mend.sentences():
            log.info("look %d: %s", look.number, said)
        lines = tuple(line.decode("ascii") for line in mend.lines)
        left_mm = sum(one.length_mm for one in mend.left)
        again = tuple(map(asdict, mended))
        return MendLines(lines, mend.left_words(), left_mm, again, given_up=bool(given_up))


def _place(at: FloatArray) -> Place:
    x, y, z = at.tolist()
    return x, y, z
