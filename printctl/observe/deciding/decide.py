"""Rules from an inspection's evidence to a decision: go on, correct, mend, pause, stop."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

from printctl.observe.deciding.decision import Decision, DecisionKind, Limits, confirmed_gaps
from printctl.observe.deciding.evidence import SURE, Evidence, Thin
from printctl.observe.deciding.flow_control import FlowControl
from printctl.observe.deciding.ink_supply import SupplyState
from printctl.observe.deciding.layers_seen import LayersSeen, where
from printctl.observe.deciding.questions import (
    asked_with_beside,
    cause_of_turn,
    doubted,
    doubts,
    low_words,
    of_whole_map,
    places_of,
    thin_words,
    unchanged,
    unconfirmed_words,
    with_untold,
)
from registration.inspection.values import Gap

# Decision about the flow, and what is said of it.


def flow_decision(
    control: FlowControl,
    tolerance: float,
    seem_thin: tuple[Thin, ...] = (),
    told: bool = True,
) -> Decision | None:
    """Return what a flow calls for; None where it is as it should be.

    Parameters
    ----------
    control : FlowControl
    tolerance : float
        Share by which it may be off.
    seem_thin : tuple of Thin
        Lines that seem to have too little ink.
    told : bool
        Whether the look has told any width: without, a flow beyond all bounds is told once more.
    """
    if control.answers.failed:
        return _unanswered(control)
    flows = f"the ink flows at {control.flow:.0%} ± {2 * control.u_flow:.0%} of what is asked for"
    if control.out_of_bounds:
        low, high = control.limits.low, control.limits.high
        why = f"{flows}: beyond a correction by {low:g} to {high:g}"
        said, control.beyond_said = control.beyond_said, not told
        if told or not said:
            why += "; this look tells no width, so whether it still is isn't known" * (not told)
            return Decision(DecisionKind.PAUSE, why)
        return None
    factor = control.proposal()
    if factor is None:
        return _likely_off(control, tolerance, seem_thin)
    return Decision(DecisionKind.FLOW, f"{flows}: factor {factor:.2f}", factor=factor)


def _likely_off(
    control: FlowControl, tolerance: float, seem_thin: tuple[Thin, ...]
) -> Decision | None:
    """Ask about a flow that is likely off, though not surely."""
    seen, factor = control.seen, control.by_last_picture()
    if seen.last is None or factor is None or factor == control.factor:
        return None
    if not seen.likely_off(control.factor, tolerance):
        return None
    seen.asked = seen.last
    share = control.factor * math.exp(seen.last.level)
    thin = seem_thin if factor > control.factor else ()
    way_mm = math.fsum(one.length_mm for one in thin)
    then = f"corrects the flow to {factor:.2f}" + f" and fills {way_mm:.1f} mm up" * bool(thin)
    return Decision(
        DecisionKind.PAUSE,
        f"lines seem to have {share:.0%} ± {2 * share * seen.last.u:.0%} of the ink asked for: "
        "the flow is off, or light makes their edges look so; look at a line or weigh the ink; "
        f"approve {then}, go on leaves it",
        factor=factor, ask=DecisionKind.FLOW, thin=thin,
    )  # fmt: skip


def _unanswered(control: FlowControl) -> Decision | None:
    """Take corrections back that weren't answered, and say so, once."""
    if control.answers.told:
        return None
    control.answers.told = True
    factor = control.proposal()
    back = "" if factor is None else f"; the factor is {factor:.2f} again"
    return Decision(
        DecisionKind.PAUSE,
        f"the flow was corrected to {control.factor:.2f}, and the width of lines hardly changed: "
        "widths are misread (a halo, blur, light or rims beside the lines), or the flow changed "
        f"again meanwhile{back}, and is corrected no more in this print: look at the lines, then "
        "resume or stop",
        factor=factor,
    )


def corrected_words(control: FlowControl, factor: float | None) -> str:
    """Which correction goes with a mend, in words; empty for none."""
    if factor is None:
        return ""
    if control.answers.failed:
        return f"; widths didn't answer corrections of the flow: factor {factor:.2f} again"
    return f"; flow {control.flow:.0%}: factor {factor:.2f}"


def uncorrected_words(control: FlowControl) -> str:
    """Say that the flow isn't corrected; empty where it is."""
    return "; the flow isn't corrected: widths didn't answer it" * control.answers.failed


_STOPPING: Final = (SupplyState.CLOGGED, SupplyState.EMPTY)
_MOST_MISSING: Final = 1 / 3
"""Of the way, that is mended unasked: where more is missing, the picture is doubted as well."""
_LEAST_INK: Final = 1 / 3
"""Of the way that was seen, on which ink lies in any print that goes on: 0.69 and more in 117 looks
at sound ones."""
_TELLING_MM: Final = 1.0
"""Way that must have been seen for that."""
_ANY: Final = 0.005
"""Of the way, less than which is nothing."""
_CLOG_MM: Final = 2.0
"""Of one gap, from which on ink had stopped coming; short lines lack a plunger's step."""
_HALF: Final = 0.5
"""Of its ink, that is written again where a line changed the picture near its middle alone: it has
a quarter to a half of it."""


@dataclass
class Decider:
    """Decides look by look, and remembers what decisions hang on.

    Attributes
    ----------
    limits : Limits
    control : FlowControl
    layers : LayersSeen
    last_shift_mm : float, mm
    """

    limits: Limits = field(default_factory=Limits)
    control: FlowControl = field(default_factory=FlowControl)
    layers: LayersSeen = field(default_factory=LayersSeen)
    last_shift_mm: float = 0.0

    def decide(self, evidence: Evidence) -> Decision:
        """Return what the look calls for, as the mode allows."""
        self.layers.add(evidence, self.limits.least_seen)
        stopping = evidence.supply.state in _STOPPING  # thin because it is about to stop: no drift
        if not stopping and evidence.turned is None and not evidence.map.lacks:
            self.control.learn(evidence.flow)
        longest = max((gap.length_mm for gap in self._believed(evidence)), default=0.0)
        self.layers.failed |= stopping or bool(longest > _CLOG_MM)  # a NumPy one can't be saved
        decision = self._as_allowed(self._wanted(evidence), evidence)
        if not evidence.alone:
            return decision
        return replace(decision, why=f"{decision.why} (by one picture: {evidence.alone})")

    def _wanted(self, evidence: Evidence) -> Decision:
        rules = (
            self._turned,
            self._shifted,
            self._stopped,
            self._narrowed,
            self._unseen,
            self._still,
            self._doubted,
            self._gaps,
            self._bare,
            self._none_yet,
            self._none_any_more,
            self._looks_bare,
            self._thin,
            self._flow,
            self._untold,
            self._hidden,
            self._blind,
        )
        for rule in rules:
            decision = rule(evidence)
            if decision is not None:
                also = "" if rule == self._thin else thin_words(evidence)
                return of_whole_map(replace(decision, why=decision.why + also), evidence)
        any_seen = evidence.seen_share >= _ANY
        seen = "as expected, within tolerance" if any_seen else "nothing was seen"
        if not any_seen and evidence.faint_share >= _ANY:
            seen = (
                f"ink shows on {evidence.faint_share:.0%}, too grainy or faint for gaps of "
                f"{self.limits.gap.least_mm:g} mm: longer ones alone are told"
            )
        if hardly := any_seen and self._hardly_seen(evidence):
            seen = f"only {evidence.seen_share:.0%} was seen; that is {seen}"
        if many := evidence.stretches:
            seen = f"{many} stretches beyond {self.limits.width_percent:g} % of width, told alone"
        seen += self._rest(evidence) if any_seen and not hardly else evidence.bare_words
        told = f"; {evidence.over_old_share:.0%} lies over older ink and can't be told from it"
        seen += told * (evidence.over_old_share >= 0.01) + evidence.came_words
        seen += unconfirmed_words(evidence, self.limits.gap)
        return Decision(DecisionKind.GO_ON, seen + uncorrected_words(self.control))

    def _rest(self, evidence: Evidence) -> str:
        """How much wasn't seen, in words, where that is more than a tolerated gap."""
        unseen_mm = evidence.way_mm * (1.0 - evidence.seen_share - evidence.over_old_share)
        told = f"; {unseen_mm:.1f} of {evidence.way_mm:.1f} mm weren't seen{evidence.hidden_words}"
        least_mm = self.limits.gap.least_mm
        return (
            told * (unseen_mm >= least_mm)
            + evidence.unjudged_words(least_mm, self.limits.width_percent)
            + low_words(evidence, self.limits.width_percent)
        )

    def _as_allowed(self, wanted: Decision, evidence: Evidence) -> Decision:
        mode = self.limits.mend
        if mode == "mend" and wanted.kind is DecisionKind.MEND and (doubt := self._doubt(evidence)):
            why = f"{wanted.why}; {doubt}: look at the picture before you approve"
            return asked_with_beside(replace(wanted, why=why), evidence)
        if wanted.kind is DecisionKind.GO_ON or mode == "mend":
            return wanted
        if mode == "tell":
            why = f"{wanted.why} (only told: observe.mend is tell)"
            return Decision(DecisionKind.GO_ON, why, wanted.gaps)
        if wanted.kind in (DecisionKind.MEND, DecisionKind.FLOW):
            return asked_with_beside(wanted, evidence)
        if wanted.factor is not None:
            return replace(wanted, ask=DecisionKind.FLOW)
        return wanted

    def _doubt(self, evidence: Evidence) -> str:
        """Why a picture isn't to be mended by unasked; empty where nothing speaks against it."""
        if evidence.alone:
            return "no second picture shows it"
        missing = math.fsum(gap.length_mm for gap in self._believed(evidence)) / evidence.way_mm
        if missing > _MOST_MISSING:
            return f"{missing:.0%} of what was written would be missing"
        if shaded := [gap for gap in self._believed(evidence) if gap.shaded]:
            way_mm = math.fsum(gap.length_mm for gap in shaded)
            return (
                f"along {way_mm:.2f} mm of it the picture changed since the one before: by the "
                "shade of lines that touch, or by ink that is level with what it lies on"
            )
        return f"only {evidence.seen_share:.0%} was seen" if self._hardly_seen(evidence) else ""

    def _hardly_seen(self, evidence: Evidence) -> bool:
        return evidence.seen_share < self.limits.least_seen * (1.0 - evidence.over_old_share)

    # --- rules -----------------------------------------------------------------------------------

    def _turned(self, evidence: Evidence) -> Decision | None:
        if evidence.turned is None:
            return None
        fits = f"the picture fits the layer better {evidence.turned}"
        cause = cause_of_turn(evidence.turned)
        return Decision(DecisionKind.PAUSE, f"{fits}: {cause}; nothing is mended by it")

    def _shifted(self, evidence: Evidence) -> Decision | None:
        shift, u = evidence.shift_mm, evidence.u_shift_mm
        before, self.last_shift_mm = self.last_shift_mm, shift
        if not evidence.aside and shift - SURE * u <= self.limits.shift_mm:
            return None
        why = (
            f"the layer lies {shift:.2f} mm beside its place (tolerance {self.limits.shift_mm:g} "
            "mm): motors have lost steps, or the dish has moved"
        )
        if before > self.limits.shift_mm and shift - before > SURE * u:
            return Decision(DecisionKind.STOP, f"{why}; it grows from look to look")
        return Decision(DecisionKind.PAUSE, f"{why}; look before you go on")

    def _stopped(self, evidence: Evidence) -> Decision | None:
        supply = evidence.supply
        if not supply.stopped:
            return None
        empty = supply.state is SupplyState.EMPTY
        cause = "the syringe is empty" if empty else "the needle is clogged"
        gaps, untold = self._believed(evidence), self.layers.untold()
        then = (
            "what is missing is mended after the cause"
            if gaps
            else "which stretches are missing isn't sure yet, and nothing is mended by this look"
        )
        if gaps and untold:
            then += f", with what the look before left untold{where(untold)}"
        if gaps:
            gaps = (*untold, *with_untold(gaps, evidence))
        why = f"no ink for the last {supply.since_ul or 0:.3g} µL: {cause}; {then}"
        return Decision(DecisionKind.PAUSE, why, gaps, ask=DecisionKind.MEND if gaps else None)

    def _narrowed(self, evidence: Evidence) -> Decision | None:
        least = self.limits.least_open
        bad = [one for one in evidence.narrowed if one.surely_below(least)]
        if not bad:
            return None
        worst = min(bad, key=lambda one: one.open_share)
        told = "closed" if worst.open_share <= 0 else f"{worst.open_share:.0%} of its width open"
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        why = f"lumen {worst.name} is {told}{more}; ink can't be taken away"
        if not (gaps := self._believed(evidence)):
            return Decision(DecisionKind.PAUSE, why)
        why += f"; approve mends gaps of {math.fsum(one.length_mm for one in gaps):.2f} mm"
        return Decision(DecisionKind.PAUSE, why, gaps, ask=DecisionKind.MEND)

    def _unseen(self, evidence: Evidence) -> Decision | None:
        if not evidence.unseen:
            return None
        bare = ", ".join(one.words for one in evidence.unseen if one.bare)
        rest = ", ".join(one.words for one in evidence.unseen if not one.bare)
        gaps, reasons = self._believed(evidence), list[str]()
        if bare:
            reasons.append(
                f"nothing is seen of {bare}: it is missing, or too faint or deep to be told from "
                "the bath"
            )
        if rest:
            reasons.append(
                f"not seen: {rest}; too faint, deep or hidden to tell whether ink is missing there"
            )
        why = (
            f"{'; '.join(reasons)}; look whether it is there: approve writes it (again), go on "
            "leaves it"
        )
        if gaps:
            way = math.fsum(gap.length_mm for gap in gaps)
            why += f"; approve also mends gaps of {way:.2f} mm elsewhere"
        whole = tuple(one.gap for one in evidence.unseen)
        return Decision(DecisionKind.PAUSE, why, (*gaps, *whole), ask=DecisionKind.MEND)

    def _doubted(self, evidence: Evidence) -> Decision | None:
        gaps = self._believed(evidence)
        reasons, once = doubts(evidence, gaps, self.limits.gap)
        wanted, why = (*gaps, *once), f"{'; '.join(reasons)}: look before it is mended"
        ask = DecisionKind.MEND if wanted else None
        return Decision(DecisionKind.PAUSE, why, wanted, ask=ask) if reasons else None

    def _gaps(self, evidence: Evidence) -> Decision | None:
        gaps, thin = self._believed(evidence), evidence.thin
        state, control = evidence.supply.state, self.control
        factor = None if control.out_of_bounds else control.proposal()
        if control.answers.failed:
            thin = ()  # widths tell nothing
        elif factor is not None and factor > control.factor:
            thin = evidence.seem_thin or thin
        if not gaps and not thin:
            return None
        way = math.fsum(gap.length_mm for gap in gaps)
        cause = "" if state in (SupplyState.FLOWING, SupplyState.UNKNOWN) else f" ({state})"
        many = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
        reasons = [f"{many}, {way:.2f} mm in all{cause}"] if gaps else []
        if thin:
            reasons.append(f"{math.fsum(one.length_mm for one in thin):.2f} mm of thin lines")
        reasons[-1] += f"{corrected_words(control, factor)}{self._rest(evidence)}"
        return Decision(DecisionKind.MEND, ", ".join(reasons), gaps, factor, thin=thin)

    def _believed(self, evidence: Evidence) -> tuple[Gap, ...]:
        return confirmed_gaps(evidence.gaps, evidence.places, evidence.second, self.limits.gap)

    def _none_yet(self, _: Evidence) -> Decision | None:
        """Ask once about what was written so far, of which no ink is seen."""
        why, stretches = self.layers.none_yet()
        return self._asked(why, stretches) if why else None

    def _none_any_more(self, _: Evidence) -> Decision | None:
        """Ask once about what didn't change though ink should lie there."""
        why, gaps = self.layers.none_any_more()
        return self._asked(why, gaps) if why else None

    def _still(self, evidence: Evidence) -> Decision | None:
        """Ask about stretches that didn't change though others of the look did."""
        still = unchanged(evidence)
        if not still:
            return None
        gaps, untold = self._believed(evidence), self.layers.untold()
        way = math.fsum(one.length_mm for one in still)
        before = f", and the look before told nothing of{where(untold)}" if untold else ""
        more = math.fsum(one.length_mm for one in gaps)
        before += f"; {more:.2f} mm are surely missing" * bool(gaps)
        return self._asked(
            f"nothing has changed along {way:.1f} mm{places_of(still)}, though it did along the "
            f"rest{before}: a clog, or ink that didn't stick",
            (*untold, *gaps, *still),
        )

    def _looks_bare(self, evidence: Evidence) -> Decision | None:
        """Ask about stretches that look bare, though the picture changed there."""
        if not (bare := doubted(evidence)):
            return None
        way_mm = math.fsum(one.length_mm for one in bare)
        return self._asked(
            f"{way_mm:.1f} mm{places_of(bare)} look bare, though the picture changed there: a "
            "gap in the shade of lines beside it, or a glint on ink; look at the picture",
            bare,
        )

    def _thin(self, evidence: Evidence) -> Decision | None:
        """Ask whether lines whose ink may be thin are to be filled up."""
        if evidence.told is None or not evidence.told.thin:
            return None
        thin = tuple(Thin(one.stroke, one.from_mm, one.to_mm, _HALF) for one in evidence.told.thin)
        why = f"{thin_words(evidence).removeprefix('; ')}: a clog in part, or a hollow below"
        then = "approve writes half of its ink again, go on leaves it"
        return Decision(
            DecisionKind.PAUSE, f"{why}; look at the picture; {then}",
            thin=thin, ask=DecisionKind.MEND,
        )  # fmt: skip

    def _asked(self, why: str, gaps: tuple[Gap, ...]) -> Decision:
        """Ask whether stretches are to be written again."""
        if not gaps:
            return Decision(DecisionKind.PAUSE, f"{why}; nothing is mended by this look")
        then = "approve writes them again once its cause is seen to, go on leaves them"
        return Decision(DecisionKind.PAUSE, f"{why}; {then}", gaps, ask=DecisionKind.MEND)

    def _flow(self, evidence: Evidence) -> Decision | None:
        tolerance = self.limits.width_percent / 100.0
        return flow_decision(self.control, tolerance, evidence.seem_thin, len(evidence.flow) > 0)

    def _bare(self, evidence: Evidence) -> Decision | None:
        if not (
            evidence.coverage < _LEAST_INK and evidence.seen_share * evidence.way_mm > _TELLING_MM
        ):
            return None
        return Decision(
            DecisionKind.PAUSE,
            f"ink lies on {evidence.coverage:.0%} of what was seen ({evidence.seen_share:.0%}), "
            "though no gap is sure: the needle is clogged, or the picture is of another place",
        )

    def _hidden(self, evidence: Evidence) -> Decision | None:
        """Say once, where ink has failed before, that from here on nothing tells of it."""
        if evidence.level_mm is None or not (self.layers.failed and self.layers.untellable):
            return None
        self.layers.failed = False
        return Decision(
            DecisionKind.PAUSE,
            f"ink has failed in this print, and {evidence.over_old_share:.0%} of this layer lies "
            "over older ink and can't be told from it: another clog would go unseen; watch the "
            "needle from here on (or use an OCT); resume goes on",
        )

    def _untold(self, evidence: Evidence) -> Decision | None:
        """Say once that nothing tells of what was written for long."""
        why, stretches = self.layers.blind() if evidence.level_mm is not None else ("", ())
        return self._asked(why, stretches) if why else None

    def _blind(self, evidence: Evidence) -> Decision | None:
        if not self.layers.view_lost(self.limits.unseen_looks):
            return None
        many = f"{self.layers.unseen} {'looks' if evidence.level_mm is None else 'layers'} in a row"
        return Decision(
            DecisionKind.PAUSE,
            f"{many} showed less than {self.limits.least_seen:.0%} of what was written (the last "
            f"{evidence.seen_share:.0%}): clean the view, or set observe off",
        )
