"""Decide after a look by expected cost: go on, correct the flow, mend, ask, or stop.

A look yields a list of concerns: missing ink, a shifted layer, a narrowed lumen, unseen way. Each
has an expected cost of going on, of acting without approval, and of asking (`Costs`, minutes of an
operator). The print pauses where asking is the cheapest for any concern, and all are reported;
otherwise the concerns that are cheapest to mend are mended.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from printctl.inspection.values import Gap
from printctl.observe.deciding.decision import (
    Costs,
    Decision,
    DecisionKind,
    Limits,
    confirmed_gaps,
)
from printctl.observe.deciding.decision_text import (
    blind_words,
    blob_words,
    cause_of_turn,
    corrected_words,
    list_places,
    map_words,
    seen_words,
    unseen_words,
)
from printctl.observe.deciding.evidence import Evidence, ThinStretch
from printctl.observe.deciding.flow_control import FlowControl, normal_part

_P_LOST_STEPS: Final = 1e-3
"""Chance that a layer lies beside its place, before a look."""
_SOUND_SHIFT_SD_MM: Final = 0.03
"""Standard deviation of a sound layer's shift."""
_MAX_LOST_STEPS_MM: Final = 2.0
"""Largest shift by lost steps; smaller ones are equally likely."""
_P_LUMEN_CLOSED: Final = 5e-3
"""Chance that a lumen is closed in part, before a look."""
_OPEN_SHARE_SD: Final = 0.05
"""Standard deviation of a sound lumen's relative width."""
_P_WRONG_PLACE: Final = 1e-3
"""Chance that a picture shows another place than it should."""
_MISSING_SHARE_SCALE: Final = 0.1
"""Share of the way: prints that lack this much more are rarer by a factor e."""
_P_ONE_PICTURE_WRONG: Final = 0.02
"""Chance that what one picture shows as missing is a passing shade or glint."""
_P_CUT_MAP_WRONG: Final = 0.5
_P_UNSIZED_MAP_WRONG: Final = 0.05
"""Chance that what a height map shows as missing lies elsewhere: it lacks rows, or may."""
_P_FALSE_THIN: Final = 0.01
_CLOGS_PER_MM: Final = 1 / 5000
_REPEATED_CLOG_FACTOR: Final = 10.0
"""Rate of clogs, and the factor on it after a failure in this print."""
_MIN_CLOG_MM: Final = 2.0
"""Length of a gap above which the ink supply had failed."""
_MIN_FLOWING_MM: Final = 1.0
"""Way seen with ink above which ink is known to flow."""
_MAX_JOIN_MM: Final = 0.2
"""Unseen stretches within this distance of an approved gap are written with it."""


@dataclass(frozen=True)
class _Concern:
    """Possible fault with the expected costs of the actions.

    Attributes
    ----------
    why : str
    go_on_cost, act_cost : float
        Expected cost of going on, and of acting without approval; minutes.
    gaps : tuple of Gap
    thin : tuple of ThinStretch
    approval : str
        What approving does, in words.
    stops : bool
        Whether the print is lost unless it ends now.
    """

    why: str
    go_on_cost: float
    act_cost: float = math.inf
    gaps: tuple[Gap, ...] = ()
    thin: tuple[ThinStretch, ...] = ()
    approval: str = ""
    stops: bool = False

    def asks(self, costs: Costs) -> bool:
        """Return whether asking is the cheapest."""
        return costs.operator < min(self.go_on_cost, self.act_cost)

    def acts(self, costs: Costs) -> bool:
        """Return whether acting without approval is the cheapest."""
        return self.act_cost < min(self.go_on_cost, costs.operator)


@dataclass
class Decider:
    """Decision maker of a print, with the state that decisions depend on.

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
        Whether the operator was informed that nothing is seen, since anything was.
    """

    limits: Limits = field(default_factory=Limits)
    control: FlowControl = field(default_factory=FlowControl)
    last_shift_mm: float = 0.0
    unseen_mm: float = 0.0
    unseen: list[Gap] = field(default_factory=list)
    failed: bool = False
    blind_said: bool = False

    def decide(self, evidence: Evidence) -> Decision:
        """Return the decision for a look, as the mode allows."""
        stopping = evidence.supply.stopped  # thin because it is about to stop: no drift
        if not stopping and evidence.turned is None and not evidence.map.lacks:
            self.control.learn(evidence.flow)
        gaps = self._confirmed_gaps(evidence)
        self._count_unseen(evidence)
        concerns = self._concerns(evidence, gaps)
        longest = max((gap.length_mm for gap in gaps), default=0.0)
        self.failed |= stopping or bool(longest > _MIN_CLOG_MM)
        wanted = self._cheapest(evidence, concerns)
        if evidence.single_picture_reason:
            wanted = replace(
                wanted, why=f"{wanted.why} (by one picture: {evidence.single_picture_reason})"
            )
        return self._restrict_to_mode(wanted, evidence)

    def _count_unseen(self, evidence: Evidence) -> None:
        """Add to the way since ink was last seen, or reset it."""
        if evidence.level_mm is None or evidence.mends_only:
            return
        seen_mm = evidence.seen_share * evidence.way_mm * max(evidence.coverage, 0.0)
        if seen_mm > _MIN_FLOWING_MM:
            self.unseen_mm, self.unseen = 0.0, []
        if evidence.seen_share >= self.limits.least_seen:
            self.blind_said = False
        self.unseen_mm += evidence.unseen_mm
        self.unseen += [one.gap for one in evidence.unseen]

    def _confirmed_gaps(self, evidence: Evidence) -> tuple[Gap, ...]:
        if evidence.turned is not None:
            return ()
        return confirmed_gaps(evidence.gaps, evidence.places, evidence.second_gaps, self.limits.gap)

    def _concerns(self, evidence: Evidence, gaps: tuple[Gap, ...]) -> list[_Concern]:
        """Return all concerns, the most expensive first."""
        each = (
            self._turned_picture(evidence),
            self._layer_shift(evidence),
            self._stopped_supply(evidence, gaps),
            self._narrowed_lumen(evidence),
            self._missing_ink(evidence, gaps),
            self._thin_lines(evidence),
            self._unseen_in_bath(evidence),
            self._unseen_way(evidence),
            self._flow_out_of_bounds(evidence),
        )
        return sorted((one for one in each if one is not None), key=lambda one: -one.go_on_cost)

    def _cheapest(self, evidence: Evidence, concerns: Sequence[_Concern]) -> Decision:
        costs = self.limits.costs
        factor = None if self.control.out_of_bounds else self.control.proposal()
        to_ask = [one for one in concerns if one.asks(costs)]
        to_mend = [one for one in concerns if one.acts(costs)]
        tolerated = [one for one in concerns if one not in to_ask and one not in to_mend]
        why = "; ".join(one.why for one in [*to_ask, *to_mend])
        rest = "".join(
            f"; {one.why}: gone on" for one in tolerated if one.go_on_cost > 0.1 * costs.operator
        )
        rest += blind_words(evidence, self.control) if factor is None else ""
        rest += map_words(evidence.map) + blob_words(evidence.blobs)
        written = concerns if to_ask else to_mend  # a person who is there anyway sees to all of it
        gaps = tuple(gap for one in written for gap in one.gaps)
        thin = tuple(gap for one in written for gap in one.thin)
        if any(one.stops for one in to_ask):
            return Decision(DecisionKind.STOP, why)
        if to_ask:
            approval = "".join(f"; {one.approval}" for one in to_ask if one.approval)
            ask = DecisionKind.MEND if gaps or thin else None
            gaps = _join_unseen(gaps, evidence)
            back = factor if self.control.answers.failed else None
            return Decision(DecisionKind.PAUSE, f"{why}{approval}{rest}", gaps, back, ask, thin)
        if to_mend:
            why += corrected_words(self.control, factor) + unseen_words(evidence)
            return Decision(DecisionKind.MEND, f"{why}{rest}", gaps, factor, thin=thin)
        if factor is not None:
            flows = _flow_words(self.control)
            return Decision(DecisionKind.FLOW, f"{flows}: factor {factor:.2f}", factor=factor)
        go_on = Decision(DecisionKind.GO_ON, seen_words(evidence, self.limits, gaps) + rest)
        return self._ask_about_flow(evidence) or go_on

    def _restrict_to_mode(self, wanted: Decision, evidence: Evidence) -> Decision:
        mode = self.limits.mend
        if wanted.kind is DecisionKind.GO_ON or mode == "mend":
            return wanted
        if mode == "tell":
            why = f"{wanted.why} (only reported: observe.mend is tell)"
            return Decision(DecisionKind.GO_ON, why, wanted.gaps)
        if wanted.kind in (DecisionKind.MEND, DecisionKind.FLOW):
            gaps = _join_unseen(wanted.gaps, evidence)
            return replace(wanted, kind=DecisionKind.PAUSE, ask=wanted.kind, gaps=gaps)
        return wanted

    # --- concerns --------------------------------------------------------------------------------

    def _turned_picture(self, evidence: Evidence) -> _Concern | None:
        if evidence.turned is None:
            return None
        why = (
            f"the picture fits the layer better {evidence.turned}: {cause_of_turn(evidence.turned)}"
        )
        return _Concern(f"{why}; nothing is mended by it", self.limits.costs.scrapped)

    def _layer_shift(self, evidence: Evidence) -> _Concern | None:
        shift, u, limit = evidence.shift_mm, evidence.u_shift_mm, self.limits.shift_mm
        before, self.last_shift_mm = self.last_shift_mm, shift
        if not math.isfinite(u) or shift <= limit:
            return None
        sound = math.hypot(_SOUND_SHIFT_SD_MM, u)
        likely = _P_LOST_STEPS / _MAX_LOST_STEPS_MM / _normal_density(shift, sound)
        chance = likely / (1.0 + likely) * _normal_tail(shift - limit, u)
        why = (
            f"the layer lies {shift:.2f} mm beside its place (tolerance {limit:g} mm): motors have "
            "lost steps, or the dish has moved"
        )
        grows = before > limit and chance * _normal_tail(shift - before, u) > 0.99
        if grows:
            why = f"{why}; it grows from look to look"
        return _Concern(why, chance * self.limits.costs.scrapped, stops=grows)

    def _stopped_supply(self, evidence: Evidence, gaps: tuple[Gap, ...]) -> _Concern | None:
        supply = evidence.supply
        if not supply.stopped or evidence.turned is not None:
            return None
        cause = "the syringe is empty" if supply.state == "empty" else "the needle is clogged"
        why = f"no ink for the last {supply.since_ul or 0:.3g} µL: {cause}"
        then = "see to the cause; approve then writes what is missing"
        unseen = [one.gap for one in evidence.unseen]
        more = tuple(one for one in self.unseen if one not in unseen) if gaps else ()
        return _Concern(why, self.limits.costs.scrapped, gaps=more, approval=then * bool(gaps))

    def _narrowed_lumen(self, evidence: Evidence) -> _Concern | None:
        least = self.limits.least_open
        chance, bad = 0.0, []
        for one in evidence.narrowed:
            if one.open_share >= least:
                continue
            likely = _P_LUMEN_CLOSED / _normal_density(
                1.0 - one.open_share, math.hypot(_OPEN_SHARE_SD, one.u)
            )
            own = likely / (1.0 + likely)
            chance = 1.0 - (1.0 - chance) * (1.0 - own)
            bad += [one] * (own > 0.5)
        if not chance:
            return None
        worst = min(evidence.narrowed, key=lambda one: one.open_share)
        width = "closed" if worst.open_share <= 0 else f"{worst.open_share:.0%} of its width open"
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        why = f"lumen {worst.name} is {width}{more}; ink can't be taken away"
        return _Concern(why, chance * self.limits.costs.scrapped)

    def _missing_ink(self, evidence: Evidence, gaps: tuple[Gap, ...]) -> _Concern | None:
        if not gaps:
            return None
        costs, way = self.limits.costs, math.fsum(gap.length_mm for gap in gaps)
        false = math.fsum(min(gap.p_value * evidence.places, 1.0) * gap.length_mm for gap in gaps)
        elsewhere = _p_common_error(way / max(evidence.way_mm, way), evidence)
        many = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
        why = f"{many}, {way:.2f} mm in all{list_places(gaps)}"
        state = evidence.supply.state
        why += f" ({state})" * (state not in ("flowing", "unknown"))
        if elsewhere * way * costs.false_ink_mm > costs.operator:
            why += f"; {way / evidence.way_mm:.0%} of what was written would be missing"
        return _Concern(
            why, costs.missed_ink_mm * way, costs.false_ink_mm * (false + elsewhere * way), gaps,
            approval="approve writes it again, go on leaves it",
        )  # fmt: skip

    def _thin_lines(self, evidence: Evidence) -> _Concern | None:
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
            costs.false_ink_mm * _P_FALSE_THIN * lacking, thin=thin,
            approval="approve fills them up, go on leaves them",
        )  # fmt: skip

    def _unseen_in_bath(self, evidence: Evidence) -> _Concern | None:
        """Return the concern of vessels unseen beyond the tolerance."""
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
        why = f"no picture shows {words}: missing, or too faint, deep or hidden to be seen"
        return _Concern(
            why, 1.01 * cost * max(way, self.limits.unseen_mm),
            gaps=tuple(one.gap for one in long),
            approval="look whether it is there: approve writes it (again), go on leaves it",
        )  # fmt: skip

    def _unseen_way(self, evidence: Evidence) -> _Concern | None:
        """Return the concern of the way since ink was last seen: a clog would lose it."""
        if evidence.level_mm is None or self.blind_said or evidence.turned is not None:
            return None
        rate = _CLOGS_PER_MM * (_REPEATED_CLOG_FACTOR if self.failed else 1.0)
        lost_mm = 0.5 * rate * self.unseen_mm**2
        gaps, way = tuple(self.unseen), self.unseen_mm
        concern = _Concern(
            f"nothing tells whether ink lies on the last {way:.0f} mm{list_places(gaps)}: light, "
            "older ink of its own look or too little contrast hides it",
            self.limits.costs.missed_ink_mm * lost_mm,
            approval="look whether it is there (this is said once; a laser line or an OCT sees it)",
        )
        if concern.asks(self.limits.costs):
            self.blind_said, self.unseen_mm, self.unseen = True, 0.0, []
        return concern

    def _flow_out_of_bounds(self, evidence: Evidence) -> _Concern | None:
        """Return the concern of a flow that no allowed factor corrects, or that didn't respond."""
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
        measured, reported = len(evidence.flow) > 0, control.beyond_said
        control.beyond_said = not measured
        if not measured and reported:
            return None
        low, high = control.limits.low, control.limits.high
        why = f"{_flow_words(control)}: beyond a correction by {low:g} to {high:g}"
        return _Concern(
            why + "; this look tells no width, so whether it still is isn't known" * (not measured),
            self.limits.costs.scrapped,
        )

    def _ask_about_flow(self, evidence: Evidence) -> Decision | None:
        """Return a question about a flow that is likely off; None if asking costs more."""
        control = self.control
        seen, factor = control.last, control.by_last_picture()
        if seen is None or factor is None or factor == control.factor or control.answers.failed:
            return None
        worth = control.cost_in_looks() > 1.0
        if not worth or not control.seems_off(self.limits.width_percent / 100):
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


def _p_common_error(missing: float, evidence: Evidence) -> float:
    """Return the chance that a seemingly missing share of the way has a common false cause."""
    if evidence.map.lacks:
        return _P_CUT_MAP_WRONG
    usual = math.exp(-missing / _MISSING_SHARE_SCALE)
    place = _P_WRONG_PLACE / (_P_WRONG_PLACE + usual)
    more = (
        _P_ONE_PICTURE_WRONG * bool(evidence.single_picture_reason)
        + _P_UNSIZED_MAP_WRONG * evidence.map.unsized
    )
    return min(1.0, place + more)


def _join_unseen(gaps: tuple[Gap, ...], evidence: Evidence) -> tuple[Gap, ...]:
    """Return gaps with the unseen stretches that join them."""
    out = list(gaps)
    for one in evidence.unseen:
        joins = any(one.gap.overlaps(gap, _MAX_JOIN_MM) for gap in gaps)
        if joins and not any(one.gap.overlaps(other) for other in out):
            out.append(one.gap)
    return tuple(out)


def _normal_density(x: float, sigma: float) -> float:
    """Return the density of a normal distribution, never 0."""
    return max(math.exp(-0.5 * (x / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi)), 1e-300)


def _normal_tail(x: float, sigma: float) -> float:
    return normal_part(x / max(sigma, 1e-6))
