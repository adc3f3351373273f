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
from shapely import MultiPoint, Polygon, unary_union

from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from firmware_profiles import Ink, Needle, Printer, Syringe, load
from kernels.arrays import FloatArray
from printctl.inspection import (
    Gap,
    LayerFindings,
    Lumen,
    SeeingOptions,
    annotated,
    find_better_orientation,
    see_layer,
)
from printctl.machine.job.job import Job, load_job
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import read_journal
from printctl.observe.deciding.evidence import ThinStretch
from printctl.observe.devices import DeviceError, Place, Region
from printctl.observe.inspection_state import InspectionState
from printctl.observe.looks.expected_ink import (
    ExpectedInk,
    MendedStretch,
    count_tries,
    expected_ink,
    inspected_ink,
    is_mended,
    last_mends,
    layer_slab,
    unseen_words,
)
from printctl.observe.looks.height_maps import refuse_other_height
from printctl.observe.looks.look_context import (
    Look,
    LookContext,
    LookJudgement,
    MendLines,
    unseen_stretches,
)
from printctl.observe.looks.look_evidence import (
    build_evidence,
    empty_evidence,
    keep_mends_only,
    record_figures,
    stretch_ends,
)
from printctl.observe.looks.map_history import MapHistory
from printctl.observe.looks.views import Image, frame_holds, image_before, open_view
from printctl.observe.mending import Gap as MendGap
from printctl.observe.mending import HeldPrint, Style, Voids, checked_mend
from printctl.observe.order import ObserverOrder
from printctl.observe.records import DRAWING_FILE, STATE_KEY, read_looks
from registration.errors import PictureError

log = logging.getLogger(__name__)
MAX_TRIES: Final = 2
_REGION_MARGIN_MM: Final = 1.5
"""Blobs are looked for within 1.2 mm of a line."""
_REGION_ABOVE_MM: Final = 0.3
_REGION_BELOW_LAYERS: Final = 8.0
"""Layers below the middle of the inspected one; one layer lower shines through a gap."""
_SPHERE_SPACING_RADII: Final = 0.25
"""Distance of the spheres that approximate a tube, in radii."""
_CIRCLE_CORNERS: Final = 24
"""Corners of a circle."""


def lumen_sections(network: VesselNetwork, z_mm: float, least_mm: float) -> tuple[Lumen, ...]:
    """Return the sections of all vessels at one height; narrower ones than ``least_mm`` left out.

    Parameters
    ----------
    network : VesselNetwork
        In the printer's frame.
    z_mm : float, mm
        Middle of the layer.
    least_mm : float, mm
    """
    angle, lumens = np.linspace(0.0, 2 * np.pi, _CIRCLE_CORNERS, endpoint=False), list[Lumen]()
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    for vessel, (points, radius) in enumerate(network.polylines()):
        if (np.abs(points[:, 2] - z_mm) - radius).min() > np.ptp(points[:, 2]):
            continue
        way = arc_lengths(points)
        count = max(int(np.ceil(way[-1] / (_SPHERE_SPACING_RADII * float(radius.min())))) + 1, 2)
        at = np.linspace(0.0, way[-1], count)
        middle, wide = places_along(points, way, at), np.interp(at, way, radius)
        half = np.sqrt(np.maximum(wide**2 - (middle[:, 2] - z_mm) ** 2, 0.0))
        rims = middle[:, None, :2] + half[:, None, None] * circle
        edges = np.flatnonzero(np.diff(np.concatenate([[0], half > 0, [0]])))
        for first, last in edges.reshape(-1, 2).tolist():
            pairs = [rims[k : min(k + 2, last)] for k in range(first, max(last - 1, first + 1))]
            area = unary_union([MultiPoint(one.reshape(-1, 2)).convex_hull for one in pairs])
            width = 2.0 * float(np.median(half[first:last]))
            for part in getattr(area, "geoms", [area]):
                if isinstance(part, Polygon) and not part.is_empty and width >= least_mm:
                    outline = np.asarray(part.exterior.coords)[:-1]
                    outline = np.column_stack([outline, np.full(len(outline), z_mm)])
                    lumens.append(Lumen(str(vessel), outline, width))
    return tuple(lumens)


@dataclass
class ObservedJob:
    """Job under observation: judges its looks and plans their mends.

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
    _kept_state: InspectionState | None = None  # until another observer's records were read
    _digest: bytes = b""  # of what was taken last
    _last: LookContext | None = None
    _map: MapHistory = field(default_factory=MapHistory)

    @cached_property
    def network(self) -> VesselNetwork | None:
        """Designed lumens, printer's frame; None if not given."""
        if not self.order.network:
            return None
        return read_network_csv(Path(self.order.network), "mm").moved(np.array(self.order.place_mm))

    @cached_property
    def _printer(self) -> Printer:
        return load(Printer, self.order.profile)

    @cached_property
    def _fluidics(self) -> tuple[Syringe, Ink, Needle]:
        order = self.order
        return load(Syringe, order.syringe), load(Ink, order.ink), load(Needle, order.needle)

    @cached_property
    def _job(self) -> Job:
        return load_job(Path(self.order.job), self._printer)

    def load(self) -> None:
        """Read job, profiles and network, so that their errors show at once.

        Raises
        ------
        ProfileError, LinkError, DesignError, OSError
        """
        _ = self._job, self._fluidics, self.network

    def _context(self, look: Look) -> LookContext:
        """Return the look's context: the print as held, with its job's inserts."""
        if self._last is None or self._last.look.number != look.number:
            inserts = read_journal(self.folder / JOURNAL).inserts
            job = self._job.grown_by([one for one in inserts if one.after < look.done])
            style: Style = "embedded" if self.order.embedded else "layered"
            held_print = HeldPrint(job.lines, look.done, self._printer, *self._fluidics, style)
            ink = expected_ink(held_print, job)
            judged = [
                one
                for one in read_looks(self.folder, self.begun)
                if one.has_judgement and one.done < look.done
            ]
            mended, before = last_mends(judged[-1].found if judged else None)
            if mended and not ink.between(look.before, look.done).any():
                look = replace(look, before=before)
            else:
                mended = ()
            layer = inspected_ink(ink, look.before, look.done)
            self._last = LookContext(
                look, held_print, job.flow, ink, layer, self._lumens(ink, look), job.marks,
                layer_slab(ink, layer), mended,
            )  # fmt: skip
        return self._last

    def region(self, look: Look) -> Region:
        """Return the box of the printer's frame that a look needs to see, mm.

        Up to above all ink, down to some layers below the ones looked at (in a bath to below the
        lowest filament), and as far aside as ink is looked for beside lines.
        """
        context = self._context(look)
        lines, (middle, thick) = context.layer.lines, context.slab_mm
        ends = np.concatenate([lines.start, lines.end])
        if not len(ends):
            ends = context.ink.end
        below = (
            _REGION_BELOW_LAYERS * thick if context.ink.layered else thick / 2 + _REGION_ABOVE_MM
        )
        low = np.append(ends[:, :2].min(axis=0) - _REGION_MARGIN_MM, middle - below)
        top = max(float(context.ink.end[:, 2].max()), middle + thick / 2)
        high = np.append(ends[:, :2].max(axis=0) + _REGION_MARGIN_MM, top + _REGION_ABOVE_MM)
        return _place(low), _place(high)

    # --- judging ---------------------------------------------------------------------------------

    @property
    def _state(self) -> InspectionState:
        return self._kept_state or InspectionState()

    def judge(self, look: Look, picture: Path, again: Path | None) -> LookJudgement:
        """Judge one or two pictures.

        Raises
        ------
        DeviceError
            When a picture can't be read, or is the last one to the last bit.
        """
        context = self._context(look)
        if self._kept_state is None:
            each = read_looks(self.folder, self.begun)
            states = [one.control.get(STATE_KEY) for one in each if one.number < look.number]
            self._kept_state = InspectionState.from_state(
                next(filter(None, reversed(states)), None)
            )
        if again is None:  # a first picture, or one that was taken anew
            context.found.clear()
        try:
            first = self._findings(context, picture)
        except PictureError as exc:
            nothing = replace(empty_evidence(), turned=context.turned)
            none = {"seen_share": 0.0, "not_seen": str(exc), "about_from": context.look.before}
            return LookJudgement(nothing, none, context.flow, self._state.state())
        judged = self._judge_findings(
            context, first, None if again is None else self._findings(context, again)
        )
        return replace(judged, learned=self._state.state())

    def _judge_findings(
        self, context: LookContext, first: LayerFindings, second: LayerFindings | None
    ) -> LookJudgement:
        limits = self.order.limits
        least = limits.gap.least_mm
        each = [one for one in (first, second) if one is not None]
        unseen = unseen_stretches(context, each, least)
        if context.mended:
            each = [_keep_mended_gaps(one, context.mended) for one in each]
        evidence = build_evidence(
            context.layer, context.ink, each[0], each[1] if second is not None else None,
            section=context.held_print.ink.bead_section, least_gap_mm=least,
            left_ul=self._left_ul(context.ink), unseen=unseen, tolerated=limits.width_percent / 100,
        )  # fmt: skip
        evidence = replace(evidence, turned=context.turned, map=context.map)
        if context.mended:  # the last look has reported the rest
            evidence = keep_mends_only(evidence)
        found = {
            **record_figures(each[0], evidence, context.ink),
            "about_from": context.look.before,
        }
        if context.size and first.seen_share < limits.least_seen:
            found["not_seen"] = self._state.size_words(context.size)
        elif context.size:
            self._kept_state = replace(
                self._state, voxel_mm=context.size.voxel_mm, size=context.size.words
            )
        if words := unseen_words(first.stations, context.mended):
            found["not_seen"] = words
        return LookJudgement(evidence, found, context.flow)

    def _findings(self, context: LookContext, path: Path) -> LayerFindings:
        """Return a picture's findings; draw those of the first one beside it."""
        if path in context.found:
            return context.found[path]
        view = open_view(path, self.order, *context.slab_mm, context.layer.lines)
        image, frame, context.size = view.image, view.frame, view.size
        heights = self.order.tells_heights
        before = None  # a camera's of the same view
        if not heights:
            before = image_before(self.folder, self.begun, context.look, path, image)
        self._check_new(view.taken, before)
        context.map = context.map.combine(self._map.check(context, view))
        if heights:  # a camera's marks hold its frame themselves
            laser = view.hidden is not None
            context.turned = find_better_orientation(
                image, frame, context.layer.lines, view.scan, in_parts=laser
            )
        is_height = heights and context.ink.layered
        if is_height and not context.map.lacks:
            image = self._map.lift_sunken_ground(context, view)
        shown = view.shown_lines(context.layer.lines)
        findings = see_layer(
            image if view.filaments is None else view.filaments,
            frame,
            shown.lines,
            lumens=context.lumens,
            before=before,
            stood_still=partial(frame_holds, before, frame),
            since=context.since[shown.row],
            hidden=() if view.hidden is None else view.hidden,
            # In a bath ink is as dark as it is thick and near: each look learns its own.
            known=self._state.appearance if context.ink.layered else None,
            thickness_mm=context.slab_mm[1] if is_height else None,
            options=self._options(),
        )
        findings = shown.with_given_rows(findings)
        refuse_other_height(context.size, findings.seen_share, findings.coverage)
        if not context.found:
            self._learn(findings)
            self._draw(
                context, view.image if view.shown is None else view.shown, frame, findings, path
            )
        context.found[path] = findings
        return findings

    def _learn(self, findings: LayerFindings) -> None:
        """Update the ink's appearance; a look that saw little of the way does so only at first.

        Where hardly any ink lies, what would be learned is how older ink and bath differ.
        """
        known, least = self._state, self.order.limits.least_seen
        if known.appearance is None or findings.seen_share >= least:
            self._kept_state = replace(known, appearance=findings.appearance or known.appearance)

    def _draw(
        self, context: LookContext, image: Image, frame: Any, findings: LayerFindings, path: Path
    ) -> None:
        """Draw findings and narrowed lumens into a copy of a picture beside it."""
        least = self.order.limits.least_open
        narrowed = [
            lumen
            for lumen, seen in zip(context.lumens, findings.lumens, strict=True)
            if seen.seen and seen.width_mm < least * seen.expected_mm
        ]
        drawn = annotated(image, frame, findings, narrowed)
        cv2.imwrite(str(path.with_name(DRAWING_FILE)), drawn)

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
        """Return lumens in the topmost layer; none for an embedded print, which writes vessels."""
        fresh = ink.between(look.before, look.done)
        if self.network is None or not ink.layered or not fresh.any():
            return ()
        top = int(np.flatnonzero(fresh)[ink.end[fresh, 2].argmax()])
        middle = float(ink.end[top, 2] - ink.height_mm[top] / 2)
        return lumen_sections(self.network, middle, float(np.median(ink.width_mm[fresh])) / 2)

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
        thin: tuple[ThinStretch, ...],
        flow: float,
        approved: bool = False,
    ) -> MendLines:
        """Plan the lines that mend gaps and fill up thin lines; report what stays unmended.

        Parameters
        ----------
        look : Look
        gaps : tuple of Gap
        thin : tuple of ThinStretch
        flow : float
            Ink that is to be pushed, over what the job's file says.
        approved : bool
            By the operator: what was written in vain before is written once more, too.
        """
        context = self._context(look)
        voids = None if self.network is None else Voids.from_network(self.network, np.zeros(3))
        wanted = [_mend_gap(one, context.ink, flow) for one in gaps]
        wanted += [_mend_gap(one, context.ink, flow) for one in thin]
        in_vain = [one for one in wanted if count_tries(one, context.mended) >= MAX_TRIES]
        given_up = [] if approved else in_vain
        mend, check = checked_mend(
            context.held_print, [one for one in wanted if one not in given_up], voids
        )
        mend = replace(mend, left=(*mend.left, *(one.left(_IN_VAIN_REASON) for one in given_up)))
        for sentence in mend.sentences():
            log.info("look %d: %s", look.number, sentence)
        if check is not None:
            log.info("look %d: the injected G-code takes %.0f s", look.number, check.duration_s)
        again = [
            MendedStretch(
                one.path, float(one.from_mm), float(one.to_mm), count_tries(one, context.mended) + 1
            )
            for one in (patch.gap for patch in mend.patches)
            if one.whole
        ]
        return MendLines(
            lines=tuple(line.decode("ascii") for line in mend.lines),
            left=mend.left_words(),
            left_mm=sum(one.length_mm for one in mend.left),
            mended=tuple(
                asdict(one) | stretch_ends(one.path, one.from_mm, one.to_mm, context.ink)
                for one in again
            ),
            given_up=bool(given_up),
        )


_IN_VAIN_REASON: Final = (
    f"written {MAX_TRIES} times more, and no ink lies there; see to needle and bath, then "
    "approve to have it written once more"
)


def _keep_mended_gaps(findings: LayerFindings, mended: tuple[MendedStretch, ...]) -> LayerFindings:
    """Return findings with the gaps in mends only."""
    return replace(findings, gaps=tuple(one for one in findings.gaps if is_mended(one, mended)))


def _mend_gap(one: Gap | ThinStretch, ink: ExpectedInk, flow: float) -> MendGap:
    """Return a gap on its path, with the flow correction since its line was written."""
    before = float(ink.factor[ink.stroke == one.stroke][0])
    end = min(one.to_mm, ink.paths[one.stroke].length_mm)
    missing = one.missing if isinstance(one, ThinStretch) else 1.0
    return MendGap(one.stroke, max(one.from_mm, 0.0), end, missing, flow / before)


def _place(at: FloatArray) -> Place:
    x, y, z = at.tolist()
    return x, y, z
