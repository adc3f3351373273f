"""Decide after a look by expected cost: go on, correct the flow, mend, ask, or stop.

What a look tells is a list of concerns: missing ink, a layer beside its place, a narrowed lumen,
way that wasn't seen. Of each it is known what it costs on average to go on, to act unasked, and to
ask (`Costs`, minutes of an operator). A print is held where asking is the cheapest for any of them,
and then all are told; else what is cheapest mended is mended.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from printctl.observe.deciding.decision import (
    Costs,
    Decision,
    DecisionKind,
    Limits,
    confirmed_gaps,
)
from printctl.observe.deciding.evidence import Evidence, Thin
from printctl.observe.deciding.flow_control import FlowControl, normal_part
from printctl.observe.deciding.words import (
    blind_words,
    blob_words,
    cause_of_turn,
    corrected_words,
    map_words,
    places_of,
    seen_words,
    unseen_words,
)
from registration.inspection.values import Gap

_LOST_STEPS: Final = 1e-3
"""Chance that a layer lies beside its place, before a look."""
_SOUND_MM: Final = 0.03
"""By which a sound layer lies beside it, one standard deviation."""
_FARTHEST_MM: Final = 2.0
"""Lost steps by so much or less are equally likely."""
_CLOSED: Final = 5e-3
"""Chance that a lumen is closed in part, before a look."""
_OPEN: Final = 0.05
"""By which a sound lumen's width scatters, of itself."""
_ANOTHER_PLACE: Final = 1e-3
"""Chance that a picture shows another place than it should."""
_MISSING: Final = 0.1
"""Of the way: prints that lack more are rarer by e for each as much."""
_ONE_PICTURE: Final = 0.02
"""Chance that what one picture shows as missing is a passing shade or glint."""
_CUT_MAP: Final = 0.5
_UNSIZED_MAP: Final = 0.05
"""Chance that what a height map shows as missing lies elsewhere: it lacks rows, or may."""
_FALSE_THIN: Final = 0.01
_CLOGS_PER_MM: Final = 1 / 5000
_CLOGS_AGAIN: Final = 10.0
"""How often ink stops for good; times as often where it has failed in this print."""
_CLOG_MM: Final = 2.0
"""Of one gap, from which on ink had failed."""
_SEEN_MM: Final = 1.0
"""Way with ink that is seen, from which on it is known to flow."""
_STEP_MM: Final = 0.2
"""Stretches that aren't told and join a gap within so much are written with it, when approved."""


@dataclass(frozen=True)
class _Concern:
    """Something that may be wrong.

    Attributes
    ----------
    why : str
    go, act : float
        Expected cost of going on, and of acting unasked; minutes.
    gaps : tuple of Gap
    thin : tuple of Thin
    then : str
        What approving does, in words.
    stops : bool
        Whether the print is lost unless it ends now.
    """

    why: str
    go: float
    act: float = math.inf
    gaps: tuple[Gap, ...] = ()
    thin: tuple[Thin, ...] = ()
    then: str = ""
    stops: bool = False

    def is_asked(self, costs: Costs) -> bool:
        """Whether asking is the cheapest."""
        return costs.operator < min(self.go, self.act)

    def is_acted_upon(self, costs: Costs) -> bool:
        """Whether acting unasked is the cheapest."""
        return self.act < min(self.go, costs.operator)


@dataclass
class Decider:
    """Decides look by look, and remembers what decisions hang on.

    Attributes
    ----------
    limits : Limits
    control : FlowControl
    last_shift_mm : float, mm
    unseen_mm : float, mm
        Way written since ink was last seen to flow.
    unseen : list of Gap
        Stretches of it.
    failed : bool
        Whether ink has failed in this print.
    blind_said : bool
        Whether the operator knows that nothing is seen, since anything was.
    """

    limits: Limits = field(default_factory=Limits)
    control: FlowControl = field(default_factory=FlowControl)
    last_shift_mm: float = 0.0
    unseen_mm: float = 0.0
    unseen: list[Gap] = field(default_factory=list)
    failed: bool = False
    blind_said: bool = False

    def decide(self, evidence: Evidence) -> Decision:
        """Return what the look calls for, as the mode allows."""
        stopping = evidence.supply.stopped  # thin because it is about to stop: no drift
        if not stopping and evidence.turned is None and not evidence.map.lacks:
            self.control.learn(evidence.flow)
        gaps = self._believed(evidence)
        self._remember(evidence)
        concerns = self._concerns(evidence, gaps)
        longest = max((gap.length_mm for gap in gaps), default=0.0)
        self.failed |= stopping or bool(longest > _CLOG_MM)
        wanted = self._cheapest(evidence, concerns)
        if evidence.alone:
            wanted = replace(wanted, why=f"{wanted.why} (by one picture: {evidence.alone})")
        return self._as_allowed(wanted, evidence)

    def _remember(self, evidence: Evidence) -> None:
        """Count the way since ink was last seen."""
        if evidence.level_mm is None or evidence.mends:
            return
        seen_mm = evidence.seen_share * evidence.way_mm * max(evidence.coverage, 0.0)
        if seen_mm > _SEEN_MM:
            self.unseen_mm, self.unseen = 0.0, []
        if evidence.seen_share >= self.limits.least_seen:
            self.blind_said = False
        self.unseen_mm += evidence.unseen_mm
        self.unseen += [one.gap for one in evidence.unseen]

    def _believed(self, evidence: Evidence) -> tuple[Gap, ...]:
        if evidence.turned is not None:
            return ()
        return confirmed_gaps(evidence.gaps, evidence.places, evidence.second, self.limits.gap)

    def _concerns(self, evidence: Evidence, gaps: tuple[Gap, ...]) -> list[_Concern]:
        """All that may be wrong, what costs most first."""
        each = (
            self._turned(evidence),
            self._shifted(evidence),
            self._stopped(evidence, gaps),
            self._narrowed(evidence),
            self._missing(evidence, gaps),
            self._thin(evidence),
            self._unseen_in_bath(evidence),
            self._unseen_way(evidence),
            self._flow_beyond(evidence),
        )
        return sorted((one for one in each if one is not None), key=lambda one: -one.go)

    def _cheapest(self, evidence: Evidence, concerns: Sequence[_Concern]) -> Decision:
        costs = self.limits.costs
        factor = None if self.control.out_of_bounds else self.control.proposal()
        asked = [one for one in concerns if one.is_asked(costs)]
        acted = [one for one in concerns if one.is_acted_upon(costs)]
        told = [one for one in concerns if one not in asked and one not in acted]
        why = "; ".join(one.why for one in [*asked, *acted])
        rest = "".join(f"; {one.why}: gone on" for one in told if one.go > 0.1 * costs.operator)
        rest += blind_words(evidence, self.control) if factor is None else ""
        rest += map_words(evidence.map) + blob_words(evidence.blobs)
        written = concerns if asked else acted  # a person who is there anyway sees to all of it
        gaps = tuple(gap for one in written for gap in one.gaps)
        thin = tuple(gap for one in written for gap in one.thin)
        if any(one.stops for one in asked):
            return Decision(DecisionKind.STOP, why)
        if asked:
            then = "".join(f"; {one.then}" for one in asked if one.then)
            ask = DecisionKind.MEND if gaps or thin else None
            gaps, back = _joined(gaps, evidence), factor if self.control.answers.failed else None
            return Decision(DecisionKind.PAUSE, f"{why}{then}{rest}", gaps, back, ask, thin)
        if acted:
            why += corrected_words(self.control, factor) + unseen_words(evidence)
            return Decision(DecisionKind.MEND, f"{why}{rest}", gaps, factor, thin=thin)
        if factor is not None:
            flows = _flow_words(self.control)
            return Decision(DecisionKind.FLOW, f"{flows}: factor {factor:.2f}", factor=factor)
        go_on = Decision(DecisionKind.GO_ON, seen_words(evidence, self.limits, gaps) + rest)
        return self._likely_off(evidence) or go_on

    def _as_allowed(self, wanted: Decision, evidence: Evidence) -> Decision:
        mode = self.limits.mend
        if wanted.kind is DecisionKind.GO_ON or mode == "mend":
            return wanted
        if mode == "tell":
            why = f"{wanted.why} (only told: observe.mend is tell)"
            return Decision(DecisionKind.GO_ON, why, wanted.gaps)
        if wanted.kind in (DecisionKind.MEND, DecisionKind.FLOW):
            gaps = _joined(wanted.gaps, evidence)
            return replace(wanted, kind=DecisionKind.PAUSE, ask=wanted.kind, gaps=gaps)
        return wanted

    # --- concerns --------------------------------------------------------------------------------

    def _turned(self, evidence: Evidence) -> _Concern | None:
        if evidence.turned is None:
            return None
        why = (
            f"the picture fits the layer better {evidence.turned}: {cause_of_turn(evidence.turned)}"
        )
        return _Concern(f"{why}; nothing is mended by it", self.limits.costs.scrapped)

    def _shifted(self, evidence: Evidence) -> _Concern | None:
        shift, u, limit = evidence.shift_mm, evidence.u_shift_mm, self.limits.shift_mm
        before, self.last_shift_mm = self.last_shift_mm, shift
        if not math.isfinite(u) or shift <= limit:
            return None
        sound = math.hypot(_SOUND_MM, u)
        likely = _LOST_STEPS / _FARTHEST_MM / _normal(shift, sound)
        chance = likely / (1.0 + likely) * _normal_tail(shift - limit, u)
        why = (
            f"the layer lies {shift:.2f} mm beside its place (tolerance {limit:g} mm): motors have "
            "lost steps, or the dish has moved"
        )
        grows = before > limit and chance * _normal_tail(shift - before, u) > 0.99
        if grows:
            why = f"{why}; it grows from look to look"
        return _Concern(why, chance * self.limits.costs.scrapped, stops=grows)

    def _stopped(self, evidence: Evidence, gaps: tuple[Gap, ...]) -> _Concern | None:
        supply = evidence.supply
        if not supply.stopped or evidence.turned is not None:
            return None
        cause = "the syringe is empty" if supply.state == "empty" else "the needle is clogged"
        why = f"no ink for the last {supply.since_ul or 0:.3g} µL: {cause}"
        then = "see to the cause; approve then writes what is missing"
        untold = [one.gap for one in evidence.unseen]
        more = tuple(one for one in self.unseen if one not in untold) if gaps else ()
        return _Concern(why, self.limits.costs.scrapped, gaps=more, then=then * bool(gaps))

    def _narrowed(self, evidence: Evidence) -> _Concern | None:
        least = self.limits.least_open
        chance, bad = 0.0, []
        for one in evidence.narrowed:
            if one.open_share >= least:
                continue
            likely = _CLOSED / _normal(1.0 - one.open_share, math.hypot(_OPEN, one.u))
            own = likely / (1.0 + likely)
            chance = 1.0 - (1.0 - chance) * (1.0 - own)
            bad += [one] * (own > 0.5)
        if not chance:
            return None
        worst = min(evidence.narrowed, key=lambda one: one.open_share)
        told = "closed" if worst.open_share <= 0 else f"{worst.open_share:.0%} of its width open"
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        why = f"lumen {worst.name} is {told}{more}; ink can't be taken away"
        return _Concern(why, chance * self.limits.costs.scrapped)

    def _missing(self, evidence: Evidence, gaps: tuple[Gap, ...]) -> _Concern | None:
        if not gaps:
            return None
        costs, way = self.limits.costs, math.fsum(gap.length_mm for gap in gaps)
        false = math.fsum(min(gap.p_value * evidence.places, 1.0) * gap.length_mm for gap in gaps)
        elsewhere = _elsewhere(way / max(evidence.way_mm, way), evidence)
        many = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
        why = f"{many}, {way:.2f} mm in all{places_of(gaps)}"
        state = evidence.supply.state
        why += f" ({state})" * (state not in ("flowing", "unknown"))
        if elsewhere * way * costs.false_ink_mm > costs.operator:
            why += f"; {way / evidence.way_mm:.0%} of what was written would be missing"
        return _Concern(
            why, costs.missed_ink_mm * way, costs.false_ink_mm * (false + elsewhere * way), gaps,
            then="approve writes it again, go on leaves it",
        )  # fmt: skip

    def _thin(self, evidence: Evidence) -> _Concern | None:
        thin, control = evidence.thin, self.control
        factor = None if control.out_of_bounds else control.proposal()
        if control.answers.failed or evidence.turned is not None:
            return None  # widths tell nothing
        if factor is not None and factor > control.factor:
            thin = evidence.seem_thin or thin
        if not thin:
            return None
        lacking = math.fsum(one.length_mm * one.missing for one in thin)
        way, costs = math.fsum(one.length_mm for one in thin), self.limits.costs
        return _Concern(
            f"{way:.2f} mm of thin lines", costs.missed_ink_mm * lacking,
            costs.false_ink_mm * _FALSE_THIN * lacking, thin=thin,
            then="approve fills them up, go on leaves them",
        )  # fmt: skip

    def _unseen_in_bath(self, evidence: Evidence) -> _Concern | None:
        """Vessels of which more isn't seen than is tolerated."""
        if evidence.level_mm is not None or not evidence.unseen:
            return None
        cost = self.limits.costs.operator / self.limits.unseen_mm
        long = [
            one for one in evidence.unseen
            if one.gap.length_mm >= min(self.limits.unseen_mm, 0.5 * one.path_mm)
        ]  # fmt: skip
        way = math.fsum(one.gap.length_mm for one in long)
        if not long:
            return None
        words = ", ".join(one.words for one in long)
        why = f"nothing is told of {words}: missing, or too faint, deep or hidden to be seen"
        return _Concern(
            why, 1.01 * cost * max(way, self.limits.unseen_mm),
            gaps=tuple(one.gap for one in long),
            then="look whether it is there: approve writes it (again), go on leaves it",
        )  # fmt: skip

    def _unseen_way(self, evidence: Evidence) -> _Concern | None:
        """Way since ink was last seen: the longer, the more is lost by a clog."""
        if evidence.level_mm is None or self.blind_said or evidence.turned is not None:
            return None
        rate = _CLOGS_PER_MM * (_CLOGS_AGAIN if self.failed else 1.0)
        lost_mm = 0.5 * rate * self.unseen_mm**2
        gaps, way = tuple(self.unseen), self.unseen_mm
        concern = _Concern(
            f"nothing tells whether ink lies on the last {way:.0f} mm{places_of(gaps)}: light, "
            "older ink of its own look or too little contrast hides it",
            self.limits.costs.missed_ink_mm * lost_mm,
            then="look whether it is there (this is said once; a laser line or an OCT sees it)",
        )
        if concern.is_asked(self.limits.costs):
            self.blind_said, self.unseen_mm, self.unseen = True, 0.0, []
        return concern

    def _flow_beyond(self, evidence: Evidence) -> _Concern | None:
        """A flow that no allowed factor corrects, or that corrections didn't change."""
        control = self.control
        if control.answers.failed and not control.answers.told:
            control.answers.told = True
            return _Concern(
                f"the flow was corrected to {control.factor:.2f}, and the width of lines hardly "
                "changed: widths are misread (a halo, blur, light or rims), or the flow changed "
                "again meanwhile; it is corrected no more in this print: look at the lines",
                self.limits.costs.scrapped,
            )
        if not control.out_of_bounds:
            return None
        told, said = len(evidence.flow) > 0, control.beyond_said
        control.beyond_said = not told
        if not told and said:
            return None
        low, high = control.limits.low, control.limits.high
        why = f"{_flow_words(control)}: beyond a correction by {low:g} to {high:g}"
        return _Concern(
            why + "; this look tells no width, so whether it still is isn't known" * (not told),
            self.limits.costs.scrapped,
        )

    def _likely_off(self, evidence: Evidence) -> Decision | None:
        """Ask about a flow that costs more than the question, though it isn't surely off."""
        control = self.control
        seen, factor = control.last, control.by_last_picture()
        if seen is None or factor is None or factor == control.factor or control.answers.failed:
            return None
        if control.looks_worth() <= 1.0:
            return None
        control.asked = True
        share = control.factor * math.exp(seen.level)
        thin = evidence.seem_thin if factor > control.factor else ()
        way_mm = math.fsum(one.length_mm for one in thin)
        then = f"corrects the flow to {factor:.2f}" + f" and fills {way_mm:.1f} mm up" * bool(thin)
        return Decision(
            DecisionKind.PAUSE,
            f"lines seem to have {share:.0%} ± {2 * share * seen.u:.0%} of the ink asked for: "
            "the flow is off, or light makes their edges look so; look at a line or weigh the ink; "
            f"approve {then}, go on leaves it",
            factor=factor, ask=DecisionKind.FLOW, thin=thin,
        )  # fmt: skip


def _flow_words(control: FlowControl) -> str:
    return f"the ink flows at {control.flow:.0%} ± {2 * control.u_flow:.0%} of what is asked for"


def _elsewhere(missing: float, evidence: Evidence) -> float:
    """Chance that what seems to be missing, a share of the way, isn't so for a common reason."""
    if evidence.map.lacks:
        return _CUT_MAP
    usual = math.exp(-missing / _MISSING)
    place = _ANOTHER_PLACE / (_ANOTHER_PLACE + usual)
    more = _ONE_PICTURE * bool(evidence.alone) + _UNSIZED_MAP * evidence.map.unsized
    return min(1.0, place + more)


def _joined(gaps: tuple[Gap, ...], evidence: Evidence) -> tuple[Gap, ...]:
    """Gaps, with stretches that aren't told and join them."""
    out = list(gaps)
    for one in evidence.unseen:
        joins = any(one.gap.overlaps(gap, _STEP_MM) for gap in gaps)
        if joins and not any(one.gap.overlaps(other) for other in out):
            out.append(one.gap)
    return tuple(out)


def _normal(x: float, sigma: float) -> float:
    """Density of a normal law, never 0."""
    return max(math.exp(-0.5 * (x / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi)), 1e-300)


def _normal_tail(x: float, sigma: float) -> float:
    return normal_part(x / max(sigma, 1e-6))
