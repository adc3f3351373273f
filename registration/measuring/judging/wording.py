"""Sentences about judged quantities: vessel, position, value, uncertainty, limit."""

from __future__ import annotations

import math

from registration.json_ready import Record

_MOST_SURE = 0.999
_NAMES = {
    "section": "diameter",
    "narrowest": "narrowest diameter",
    "mean": "mean diameter",
    "change": "diameter within a junction, as a circle of the same area,",
}
_DOUBTS = {
    "shade": ": not proven, as gel below a bubble or a particle looks alike; see its picture",
    "axis": ": not proven, as the axis that was found may not follow its lumen there",
    "faint": ": not proven, as gel is left in it; a crack thinner than 0.1 mm, or thin gel, looks "
    "so; see its picture",
}


def reason(feature: Record) -> str:
    """Word a feature of ``judging.features``: measured value, limit, and decision."""
    name = feature["name"]
    if feature.get("doubt") == "pose":
        return f"{reason({**feature, 'decision': 'fail', 'doubt': ''})}, if the pose is right"
    if feature.get("doubt") == "symmetry":
        return f"{reason({**feature, 'doubt': ''})}, if this is vessel {feature['as_vessel']}"
    if name in _NAMES:
        return _diameter(feature)
    if name == "offset" and feature.get("doubt") == "no limit":
        return (
            f"{_place(feature)}: the lumen lies {_measured(feature)} beside its designed axis, "
            "more than half its radius, and no limit is given; say what is allowed (position_um)"
        )
    if name == "oval":
        return (
            f"{_place(feature)}: oval, its longest width {_measured(feature)} more than its "
            f"shortest, limit {feature['limit']}{_end(feature)}"
        )
    if name == "offset":
        return f"{_place(feature)}: axis off by {_measured(feature)} of {feature['limit']}" + _end(
            feature
        )
    if name == "rms":
        return f"RMS deviation after scaling {_rms(feature)}, allowed {feature['limit']}"
    if name == "rigid":
        return f"RMS deviation without scaling {_rms(feature)}, allowed {feature['limit']}"
    if name == "size":
        return _size(feature)
    if name == "leak":
        return _way(feature)
    if name == "zone":
        return _zone(feature)
    return _sight(feature)


def _rms(feature: Record) -> str:
    value, u = feature.get("value_um"), feature.get("u_um")
    if value is None:
        return "not known"
    if u is None:
        return f"{value:.1f} µm"
    return f"{value:.1f} µm (95 %: {max(value - u, 0.0):.1f} to {value + u:.1f} µm)"


def _size(feature: Record) -> str:
    """Word a size: how much the print is longer or shorter along an axis."""
    axis, value, u = feature["of"], feature.get("value_um"), feature.get("u_um")
    if value is None:
        known = "not measured"
    else:
        percent, half = (100 * v / feature["designed_um"] for v in (value, u or 0.0))
        ends = "unknown" if u is None else f"{half:.1f}"
        known = f"{signed(percent)} ± {ends} % ({signed(value, 0)} µm)"
    text = f"Size along {axis}: {known}, limit {feature['limit']}"
    if feature.get("doubt") == "index":
        return f"{text}: not proven, as depth rests on the refractive index; scan a depth standard"
    remedy = feature.get("words")
    return text + _end(feature) + (f"; for a narrower interval, {remedy}" if remedy else "")


def _way(feature: Record) -> str:
    other = feature.get("other")
    to = "out" if other is None else f"into vessel {other}"
    text = f"{_place(feature)}: a way {_measured(feature)} wide leads {to}, {feature['limit']}"
    if feature["decision"] == "undecided" and not feature.get("doubt") and feature.get("u_um"):
        return f"{text}: not proven, as its own interval leaves room for none; see its picture"
    return text + _DOUBTS.get(feature.get("doubt", ""), "")


def _zone(feature: Record) -> str:
    """Say of a zone: its width, interval and limit."""
    value, ends = feature.get("value_um"), feature.get("interval_um")
    place = str(feature["of"])
    text = f"{place[:1].upper()}{place[1:]}: {feature['words']} "
    if value is None or not ends:
        return f"{text}isn't known, limit {feature['limit']}"
    ends_said = f"{ends[0]:.0f} to {ends[1]:.0f}"
    unseen = feature["decision"] == "undecided" and ends[1] <= feature["upper_um"]
    end = ": not all of it was seen" if unseen else _end(feature)
    return f"{text}{value:.0f} µm ({ends_said} µm, 95 %), limit {feature['limit']}{end}"


def _diameter(feature: Record) -> str:
    designed = feature["designed_um"]
    if feature["value_um"] <= -designed:
        return (
            f"{_place(feature)}: closed, with {designed:.0f} µm designed, limit {feature['limit']}"
        )
    percent = signed(100 * feature["value_um"] / designed)
    u = feature.get("u_um")
    half = "" if u is None else f" ± {100 * u / designed:.1f}"
    um = f"{signed(feature['value_um'], 0)}{'' if u is None else f' ± {u:.0f}'} µm"
    return (
        f"{_place(feature)}: {_NAMES[feature['name']]} {percent}{half} % ({um}), "
        f"limit {feature['limit']}{_by_chance(feature) or _end(feature)}"
    )


def _by_chance(feature: Record) -> str:
    """Say why a value beyond its limit by more than U is no fail; empty of all others."""
    u, wide = feature.get("u_um"), feature.get("fail_um")
    if feature["decision"] != "undecided" or u is None or wide is None or _beyond(feature) <= u:
        return ""
    percent = 100 * wide / feature["designed_um"]
    return (
        f": beyond the limit, but among many sections one may be off by ± {percent:.1f} % through "
        "measurement noise alone, so undecided"
    )


def _beyond(feature: Record) -> float:
    """Return how far a value lies beyond its limits, µm; below 0 within them."""
    ends = feature.get("lower_um", -math.inf), feature.get("upper_um", math.inf)
    return float(max(ends[0] - feature["value_um"], feature["value_um"] - ends[1]))


def _end(feature: Record) -> str:
    """Say what was decided, and why where the value alone would say otherwise."""
    if feature["decision"] == "pass":
        return _passed(feature)
    end = {"undecided": ": too close to the limit to decide", "fail": ": out of tolerance"}[
        feature["decision"]
    ]
    probability = feature.get("probability")
    if probability is None:
        return end
    return f"{end} (the vessel is within tolerance with a probability of {_percent(probability)})"


def _passed(feature: Record) -> str:
    """Explain the pass of a section whose interval reaches beyond its limit; else empty."""
    probability, u = feature.get("probability"), feature.get("u_um")
    if probability is None or u is None or _beyond(feature) + u <= 0:
        return ""
    odds = f"the vessel is within tolerance with a probability of {_percent(probability)}"
    if _beyond(feature) <= 0:
        return f" ({odds})"
    return (
        f": this single reading is beyond the limit by less than its own scatter; taken together "
        f"with the other sections, {odds}"
    )


def _percent(probability: float) -> str:
    if probability > _MOST_SURE:
        return f"over {100 * _MOST_SURE:.1f} %"
    return f"{100 * probability:.0f} %"


def _sight(feature: Record) -> str:
    vessel, stretches = _vessel(feature), feature.get("unseen_mm", ())
    where = ", ".join(f"{first:.1f} to {last:.1f} mm" for first, last in stretches)
    if feature["name"] == "seen":
        return f"{vessel}: not visible in the scan from {where} along, so it may be closed there"
    if feature["name"] == "gel_like":
        return (
            f"{vessel}: the lumen looks partly like gel from {where} along (a film, sediment, weak "
            "gel or a reflection), so it may be closed there"
        )
    if feature["name"] == "measured":
        return (
            f"{vessel}: no complete wall found from {where} along, so the diameter wasn't measured "
            "there"
        )
    if feature["name"] == "unsure":
        return (
            f"{vessel}: the axis found in the model may not follow the lumen from {where} along, "
            "so the vessel wasn't measured there; give --network to have it measured"
        )
    if feature["decision"] == "fail":
        return f"{vessel}: closed"
    if feature["decision"] == "undecided":
        return f"{vessel}: not visible from end to end, so it may be closed"
    return f"{vessel}: open"


def _place(feature: Record) -> str:
    at = feature.get("at_mm")
    return _vessel(feature) + ("" if at is None else f", {at:.1f} mm along")


def _vessel(feature: Record) -> str:
    """Name a vessel, and those that it may be where the design is the same in several poses."""
    names = sorted([feature["vessel"], *feature.get("or_vessels", ())])
    if len(names) < 2:
        return f"Vessel {names[0]}"
    return f"Vessel {', '.join(map(str, names[:-1]))} or {names[-1]}"


def _measured(feature: Record) -> str:
    value, u = feature.get("value_um"), feature.get("u_um")
    if value is None:
        return "an unknown amount"
    return f"{value:.0f} ± {'unknown' if u is None else f'{u:.0f}'} µm"


def signed(value: float, decimals: int = 1) -> str:
    """A number with its sign, a true minus, and no negative zero."""
    text = f"{value:+.{decimals}f}"
    if not text.strip("+-0."):
        text = "+" + text[1:]
    return text.replace("-", "\N{MINUS SIGN}")
