"""Verdict on a print from the decisions of `measuring.judging`, the pose and the flow."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final

from printctl.pipeline.judging.common_causes import THROUGHOUT, common_causes, print_faults
from printctl.pipeline.judging.premises import Finding, mismatch, premises
from registration.json_ready import Record, Verdict
from registration.measuring.judging import (
    Decision,
    decision_at_sure_pose,
    pose_in_doubt,
    reason,
    worst_decision,
)
from report.sections.gauging import pressure_words

MOST_REASONS: Final = 10
"""Of features, the worst; the page's tables have all."""
_OF_PLACE: Final = ("position_um", "profile_um")
"""Zones that an axis may not leave, or a wall."""
_ORDER: Final[tuple[Decision, ...]] = ("fail", "undecided", "pass")


def verdict(registration: Record) -> Verdict:
    """Collect the decisions on a judged registration.

    The print passes when every feature of every vessel passes, the pose is unambiguous and every
    vessel that should carry flow does. It fails when one of these fails. Else it is undecided:
    neither is proven. Of a part that may lie otherwise nothing is proven. A scan of another part
    fails, for that reason alone; one with wrong voxels is undecided for that reason alone.

    Parameters
    ----------
    registration : dict
        Of registration.json, as `registration.measuring.judging.judge` returned it.

    Returns
    -------
    dict
        ``passed``, ``undecided`` (bool), ``causes`` (list of str: what explains most of the rest),
        ``reasons`` (list of str; causes first, then fails, the worst first).

    Raises
    ------
    KeyError
        When it wasn't judged: an older version wrote it.
    """
    if (wrong := mismatch(registration)) is not None:
        return {
            "passed": False,
            "undecided": wrong[0] == "undecided",
            "causes": [wrong[1]],
            "reasons": [wrong[1]],
        }
    features = registration["judging"]["features"]
    worst_first, of_features = _of_features(registration, features)
    faults = print_faults(registration)
    alike = common_causes(registration, worst_first)
    causes = [text for _, text in faults] + alike
    pose = _pose(registration)
    others: list[Finding] = [
        *_proven(registration, features),
        *(_in_this_pose(registration, *one) for one in _flow(registration)),
        *(one for one in pose if one[0] == "pass"),
        *_unfollowed(registration),
        *_places(registration),
        *_not_judged(registration),
    ]
    # A doubtful pose comes before all that follows from it.
    leading = [one for one in pose if one[0] != "pass"]
    first = premises(registration)
    whole = worst_decision(
        decision for decision, _ in [*faults, *first, *leading, *of_features, *others]
    )
    reasons = [text for _, text in faults]
    reasons += [text for decision, text in first if decision != "pass"]
    reasons += alike + [
        text
        for decision in _ORDER
        # No table has the others: none of them is left out.
        for text in [
            *(t for d, t in leading if d == decision),
            *_some(of_features, decision),
            *(t for d, t in others if d == decision),
        ]
    ]
    reasons += [text for decision, text in first if decision == "pass"]
    if registration.get("written") == "cords":
        causes = [_of_cords(text) for text in causes]
        reasons = [*map(_of_cords, reasons), AS_SOLID]
    return {
        "passed": whole == "pass",
        "undecided": whole == "undecided",
        "causes": causes,
        "reasons": reasons,
    }


def _of_features(
    registration: Record, features: Sequence[Record]
) -> tuple[list[Record], list[Finding]]:
    """Return the features that don't pass, the worst first, and a finding for each."""
    missing = {f["vessel"] for f in registration.get("findings", ()) if f["kind"] == "missing"}
    worst_first = [
        f
        for f in sorted(_worth_saying(features), key=_beyond, reverse=True)
        # Of a lumen that isn't there nothing else is worth saying.
        if f["name"] == "open" or f.get("vessel") not in missing
    ]
    throughout = _throughout(registration)
    of_features: list[Finding] = []
    for f in worst_first:
        text = reason(f)
        if f["name"] == "open" and f["decision"] == "fail" and f["vessel"] in missing:
            text = f"Vessel {f['vessel']} is missing: no lumen was found along it"
        elif f["name"] == "section" and f["vessel"] in throughout:
            text = f"{text}; {throughout[f['vessel']]}"
        of_features.append((f["decision"], text))
    return worst_first, of_features


AS_SOLID: Final = (
    "Solid cords (toolpath.writes: cords): diameters and positions are compared with the design; "
    "not evaluated as lumens"
)
_CORD_WORDS: Final = {
    "lumen": "cord", "lumens": "cords", "vessel": "cord", "vessels": "cords", "open": "unbroken",
    "closed": "broken", "leak": "stray ink", "leaks": "stray ink", "gel": "ink",
}  # fmt: skip


def _of_cords(text: str) -> str:
    """Say of solid cords what a sentence says of lumens."""

    def cord(word: re.Match[str]) -> str:
        said = _CORD_WORDS[word[0].lower()]
        return said.capitalize() if word[0][0].isupper() else said

    return re.sub(rf"\b({'|'.join(_CORD_WORDS)})\b", cord, text, flags=re.IGNORECASE)


def _in_this_pose(registration: Record, decision: Decision, text: str) -> Finding:
    """Return a finding on flow as `judge` does those on features."""
    if decision == "fail" and pose_in_doubt(registration["ambiguity"]):
        return "undecided", f"{text}, if the pose is right"
    return decision, text


def _worth_saying(features: Sequence[Record]) -> list[Record]:
    """What isn't a pass; of a vessel's mean only where its worst section doesn't say as much."""
    sure = [decision_at_sure_pose(f) for f in features]
    hidden = {f["vessel"] for f in features if f["name"] in ("seen", "gel_like")}
    by_section = {f["vessel"]: f["decision"] for f in sure if f["name"] == "section"}
    return [
        f
        for f, plain in zip(features, sure, strict=True)
        if f["decision"] != "pass"
        # Where it may be closed says more than that it may be.
        and not (f["name"] == "open" and f["decision"] == "undecided" and f["vessel"] in hidden)
        and not (
            f["name"] in ("mean", "narrowest")
            and worst_decision([plain["decision"], by_section.get(f["vessel"], "pass")])
            == by_section.get(f["vessel"])
        )
    ]


def _beyond(feature: Record) -> float:
    """Return how far a value lies off over its limit on that side; inf without a value."""
    value = feature.get("value_um")
    if value is None:
        return math.inf
    limit = feature.get("upper_um" if value >= 0 else "lower_um")
    return abs(value / limit) if limit else abs(value)


def _throughout(registration: Record) -> dict[int, str]:
    """Say of vessels that fail nearly all along that they do: a width, not a place."""
    out = {}
    for row in registration["vessels"]:
        along = row.get("decision_along") or ()
        failed = sum(one == "fail" for one in along)
        off = row.get("error_percent")
        if off and row["open"] and failed >= THROUGHOUT * max(len(along), 1):
            word = "narrower" if off < 0 else "wider"
            out[row["vessel"]] = f"it is {word} nearly all along, by {abs(off):.1f} % in the mean"
    return out


def _some(findings: Sequence[Finding], decision: Decision) -> list[str]:
    texts = [text for one, text in findings if one == decision]
    worse = sum(_ORDER.index(one) < _ORDER.index(decision) for one, _ in findings)
    room = max(MOST_REASONS - worse, 0)
    left = len(texts) - room
    if left <= 0:
        return texts
    many = left > 1
    word = {
        "fail": "fail" if many else "fails",
        "undecided": "are undecided" if many else "is undecided",
        "pass": "pass" if many else "passes",
    }[decision]
    return [*texts[:room], f"{left} more {word}; the table of vessels has all"]


def _proven(registration: Record, features: Sequence[Record]) -> list[Finding]:
    """What passes, in a line each."""
    vessels = registration["vessels"]
    good = [row for row in vessels if row["decision"] == "pass"]
    text = f"{len(good)} of {len(vessels)} vessels pass"
    passing = {row["vessel"] for row in good}
    sections = [f for f in features if f["name"] == "section" and f["vessel"] in passing]
    if sections:
        largest = max(sections, key=lambda f: abs(f["value_um"]) / f["designed_um"])
        text += f"; largest deviation: {reason(largest)}"
    out: list[Finding] = [("pass", text)]
    if all(row["open"] is True for row in vessels):
        many = f"All {len(vessels)} vessels are" if len(vessels) > 1 else "The vessel is"
        out.append(("pass", f"{many} open"))
    if not any(f["name"] == "leak" for f in features) and not pose_in_doubt(
        registration["ambiguity"]
    ):  # in doubt none is listed
        out.append(("pass", f"No leak or bridge between vessels found{_leak_limit(registration)}"))
    rms = [f for f in features if f["name"] == "rms" and f["decision"] == "pass"]
    return [*out, *(("pass", reason(f)) for f in rms)]


def _leak_limit(registration: Record) -> str:
    """Say how narrow a leak may be without showing in this scan."""
    contrast = registration.get("contrast") or {}
    if not contrast.get("leak_um"):
        return ""
    voxel = (registration.get("measured_by") or {}).get("voxel_um")
    by = f"voxel {' × '.join(f'{v:.3g}' for v in voxel)} µm, " if voxel else ""
    return (
        f"; ones narrower than {contrast['leak_um']:.0f} µm can't be resolved in this scan "
        f"({by}edge blur {contrast['blur_um']:.0f} µm){_too_dim(contrast)}"
    )


LEAST_DIM: Final = 0.005
"""Of the gel: less of it, unexamined for leaks, isn't worth a word."""


def _too_dim(contrast: Record) -> str:
    dim = 1 - contrast.get("examined", 1.0)
    return f"; {100 * dim:.0f} % of the gel is too dim to be examined" if dim >= LEAST_DIM else ""


def _unfollowed(registration: Record) -> list[Finding]:
    """Say how much of the lumens no vessel that was found in the model follows, and where."""
    left = registration.get("unfollowed") or {}
    if not left.get("at_mm"):
        return []
    where = "; ".join("x {:.1f}, y {:.1f}, z {:.1f}".format(*at) for at in left["at_mm"][:3])
    more = f"; {len(left['at_mm']) - 3} more places" if len(left["at_mm"]) > 3 else ""
    text = (
        f"{100 * left['share']:.2g} % of the lumens' volume belongs to no vessel found in the "
        f"model (at {where} mm{more}), so it wasn't measured; give --network to have it measured"
    )
    return [("undecided", text)]


def _not_judged(registration: Record) -> list[Finding]:
    """Name what has no tolerance, so that a pass isn't read as one of position and shape."""
    tolerances = registration["judging"]["tolerances"]
    own = any(key in row for row in tolerances["vessels"] for key in _OF_PLACE)
    of = "lumens without a tolerance of their own" if own else "lumens"
    lacking = [
        *([] if any(k in tolerances for k in _OF_PLACE) else [f"position of {of} (position_um)"]),
        *([] if "face_profile_um" in tolerances else [_outer_faces(registration)]),
    ]
    if not lacking:
        return []
    return [("pass", f"Not evaluated (no tolerance set): {'; '.join(lacking)}")]


def _outer_faces(registration: Record) -> str:
    surfaces = registration.get("by_surface") or {}
    faces = (surfaces.get("outer_faces") or {}).get("scaled") or {}
    if faces.get("max_um") is None:
        return "outer faces (face_profile_um)"
    return (
        f"outer faces (face_profile_um): 95 % within {faces['p95_um']:.0f} µm, largest deviation "
        f"{faces['max_um']:.0f} µm"
    )


def _places(registration: Record) -> list[Finding]:
    """Where outer faces stand out: the three largest places."""
    surfaces = registration.get("by_surface") or {}
    places = (surfaces.get("outer_faces") or {}).get("places") or []
    if not places:
        return []
    text = "; ".join(_place_words(one) for one in places[:3])
    more = f"; {len(places) - 3} more" if len(places) > 3 else ""
    return [("pass", f"Outer faces deviate from the design: {text}{more}")]


def _place_words(place: Record) -> str:
    x, y, z = (f"{value:.1f}".replace("-", "−") for value in place["at_mm"])
    off = place["deviation_um"]
    return (
        f"{'gel missing' if off > 0 else 'gel in excess'} by {abs(off):.0f} µm over "
        f"{place['area_mm2']:.1f} mm² at x {x}, y {y}, z {z} mm"
    )


def _flow(registration: Record) -> list[Finding]:
    flow = registration.get("perfusion")
    if not flow:
        return []
    starved = [str(row["vessel"]) for row in flow["vessels"] if not row["fed"]]
    if starved:
        few = _few(starved)
        count_text = "1 vessel carries" if len(starved) == 1 else f"{len(starved)} vessels carry"
        return [("fail", f"{count_text} no flow as printed: {few}")]
    drop, designed = flow["pressure_drop_pa"], flow["designed_pressure_drop_pa"]
    if not drop or not designed:
        return []
    shift = max(abs(row["share"] - row["designed_share"]) for row in flow["vessels"])
    known = flow if flow.get("pressure_ratio") else {"pressure_ratio": drop / designed}
    needs = f"pressure drop {pressure_words(known)} times the designed one"
    if len(flow["vessels"]) > 1:
        needs += f", flow split within {100 * shift:.1f} percentage points of the design"
    unsure = [str(row["vessel"]) for row in registration["vessels"] if row["open"] is None]
    if unsure:
        which = f"vessel {unsure[0]} is" if len(unsure) == 1 else f"vessels {_few(unsure)} are"
        return [("undecided", f"Perfusion not confirmed; if {which} open: {needs}")]
    return [("pass", f"Every vessel is perfused; {needs}")]


def _few(vessels: Sequence[str]) -> str:
    return ", ".join(vessels[:8]) + (" …" if len(vessels) > 8 else "")


def _pose(registration: Record) -> list[Finding]:
    ambiguity = registration["ambiguity"]
    if not ambiguity["flag"]:
        return [("pass", "The pose is unambiguous")]
    symmetry = registration["judging"].get("symmetry")
    if symmetry and not pose_in_doubt(ambiguity):
        return [_same_in(registration, symmetry)]
    doubts = ambiguity.get("doubts") or ["another one fits nearly as well"]
    return [("undecided", f"The pose is ambiguous: {doubts[0]}")]


def _same_in(registration: Record, symmetry: Record) -> Finding:
    """Say that the design is the same in several poses, and whether the verdict is."""
    *most, last = symmetry["motions"][:3]
    motions = f"{', '.join(most)} or {last}" if most else last
    swaps = " and ".join(_vessels(one) for one in symmetry["vessels"][:3])
    same = f"The design is the same after {motions}"
    if symmetry["agree"]:
        which = f" ({swaps} can't be told apart)" if swaps else ""
        return ("pass", f"{same}{which}; the verdict holds whichever way it lay")
    rows = {int(row["vessel"]): row for row in registration["vessels"]}
    of = [rows[v] for one in symmetry["vessels"] for v in one]
    sizes = sorted({round(float(row["designed_um"])) for row in of})
    differ = (
        f"they are designed {' and '.join(map(str, sizes))} µm wide"
        if len(sizes) > 1
        else "their tolerances differ"
    )
    return (
        "undecided",
        f"{same}, so {swaps} can't be told apart, but {differ}, and the verdict depends on which "
        "is which; add a mark that the scan shows: a dimple in an outer face, or a short blind "
        "channel where lumens alone are scanned",
    )


def _vessels(numbers: Sequence[int]) -> str:
    return f"vessels {', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"
