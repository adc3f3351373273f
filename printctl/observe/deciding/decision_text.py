"""Text of what a look saw, and of its decision."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from printctl.inspection.options import IN_PART
from printctl.inspection.values import Blob, Gap
from printctl.observe.deciding.decision import Limits
from printctl.observe.deciding.evidence import Evidence, MapCheck
from printctl.observe.deciding.flow_control import FlowControl

_MAX_LISTED: Final = 3
"""Stretches or blobs that are listed by place."""
_MIN_SEEN_SHARE: Final = 0.005
"""Share of the way below which nothing counts as seen."""
_MAX_SILENT_FLOW_ERROR: Final = 0.1
"""Relative flow error above which an undetectable error is mentioned."""


def seen_words(evidence: Evidence, limits: Limits, gaps: Sequence[Gap]) -> str:
    """Return in words what a look that needs no action has shown."""
    if evidence.seen_share < _MIN_SEEN_SHARE:
        return f"nothing was seen{unseen_words(evidence)}"
    if evidence.stretches:
        beyond = f"beyond {limits.width_percent:g} % of width"
        text = f"{evidence.stretches} stretches {beyond}, only reported"
    else:
        text = "as expected, within tolerance"
    unseen = unseen_words(evidence)
    if unseen:
        text = f"of the {evidence.seen_share:.0%} that was seen: {text}"
    significant = [one for one in evidence.gaps if limits.gap.significant(one, evidence.places)]
    if significant and not gaps:
        way = math.fsum(one.length_mm for one in significant)
        text += f"; {way:.2f} mm seem to be missing in one of two pictures alone: not believed"
    return text + unseen


def blind_words(evidence: Evidence, control: FlowControl) -> str:
    """Return in words that the flow may be off undetected; empty if it is known.

    Empty for a look in which nothing was seen.
    """
    if evidence.mends_only or evidence.seen_share < _MIN_SEEN_SHARE:
        return ""
    if not control.may_be_off(_MAX_SILENT_FLOW_ERROR):
        return ""
    if control.last is None:
        return "; no line tells its width, so the flow may be off unseen"
    share = control.factor * math.exp(control.last.level)
    return (
        f"; lines seem to have {share:.0%} ± {2 * share * control.last.u:.0%} of the ink asked "
        "for: a smaller error isn't detected"
    )


def unseen_words(evidence: Evidence) -> str:
    """Return in words how much wasn't seen and where; empty below a tolerated gap."""
    longest = sorted(evidence.unseen, key=lambda one: -one.gap.length_mm)
    if not longest and evidence.seen_share > 0.5:
        return ""
    words = [one.words for one in longest[:_MAX_LISTED]]
    more = f" and {len(longest) - _MAX_LISTED} shorter" if len(longest) > _MAX_LISTED else ""
    places = f": {', '.join(words)}{more}" if words else ""
    return f"; {evidence.unseen_mm:.1f} of {evidence.way_mm:.1f} mm weren't seen{places}"


def list_places(stretches: Sequence[Gap]) -> str:
    """Return the places of the first stretches in words; empty for none."""
    each = []
    for one in stretches[:_MAX_LISTED]:
        begin, end = (f"X {x:.1f} Y {y:.1f}" for x, y in (one.start_mm, one.end_mm))
        each.append(f"{begin} to {end}, {one.length_mm:.2f} mm")
    more = f"; and {len(stretches) - _MAX_LISTED} more" * (len(stretches) > _MAX_LISTED)
    return f" ({'; '.join(each)}{more})" if each else ""


def map_words(check: MapCheck) -> str:
    """Return in words what a height map lacks and how far its ground has sunk."""
    lacks = f"; the map {check.lacks}: what lies behind lost ones shows aside" * bool(check.lacks)
    if not check.sunk_mm > 0.0:
        return lacks
    return (
        f"{lacks}; what the layer lies on has sunk by up to {1e3 * check.sunk_mm:.0f} µm, and its "
        "ink is judged by its rise over that"
    )


def blob_words(blobs: Sequence[Blob]) -> str:
    """Return the layer's blobs in words, the largest first."""
    largest = sorted(blobs, key=lambda one: -one.area_mm2)
    if not largest:
        return ""
    each = [
        f"X {one.at_mm[0]:.1f} Y {one.at_mm[1]:.1f}, {one.width_mm:.2f} mm wide, "
        f"{1e3 * one.height_mm:.0f} µm over the ink"
        for one in largest[:_MAX_LISTED]
    ]
    more = f" and {len(largest) - _MAX_LISTED} smaller" if len(largest) > _MAX_LISTED else ""
    many = "1 blob stands" if len(largest) == 1 else f"{len(largest)} blobs stand"
    return f"; {many} on the layer ({'; '.join(each)}{more})"


def cause_of_turn(turned: str) -> str:
    """Return what to check when a picture fits its layer better turned or moved."""
    if turned.endswith(IN_PART):
        return "the map lacks rows or columns, or motors lost steps within the layer: look anew"
    if turned.startswith("moved"):
        return "motors have lost steps, or dish or device have moved: check both, then the frame"
    return "check the device's axes and observe.frame"


def corrected_words(control: FlowControl, factor: float | None) -> str:
    """Return in words the flow correction of a mend; empty for none."""
    if factor is None:
        return ""
    if control.answers.failed:
        return f"; widths didn't answer corrections of the flow: factor {factor:.2f} again"
    return f"; flow {control.flow:.0%}: factor {factor:.2f}"
