"""Facts of a print in words for the Job page: time left, layer, ink, temperatures, tip, alarms."""

from __future__ import annotations

from typing import Any, Final

from printctl.machine.link.states import LinkState
from printctl.machine.printing.print_words import clock, span
from printctl.machine.station.status import OPEN

FACTS: Final = {
    "time": "Time left",
    "layer": "Layer",
    "ink": "Ink",
    "heat": "Temperatures",
    "tip": "Tip",
    "alarms": "Alarms",
}
"""Key and name of each, in the order shown."""
_UNKNOWN: Final = "not known"
_RAISED: Final = {
    LinkState.PAUSED: "raised from ",
    LinkState.LOOKING: "raised from ",
    LinkState.RESUMING: "raised from ",
    LinkState.STOPPING: "raised from about ",
    LinkState.STOPPED: "raised from about ",
    LinkState.FAILED: "raised from about ",
}
"""States in which the needle is no longer where the job's lines have brought it."""


def facts(state: dict[str, Any], station: dict[str, Any] | None) -> dict[str, str]:
    """Return each fact in words.

    Parameters
    ----------
    state : dict
        The print, as `PrintTruth.to_dict` gives it.
    station : dict or None
        The printer, as its station tells it.
    """
    done = state["progress"]
    return {
        "time": _time(state, done),
        "layer": _layer(state, done),
        "ink": _ink(done),
        "heat": _heat(station),
        "tip": _tip(state, done),
        "alarms": _alarms(state),
    }


def _time(state: dict[str, Any], done: dict[str, Any] | None) -> str:
    left = state["time_left_s"]
    if left is None:
        return "not printing" if state["ended"] else _UNKNOWN
    error = done["remaining_error_s"] if done else None
    about = "" if error is None else f" ± {span(error)}"
    return f"{span(left)}{about}" + (f", until {clock(done['ends_at'])}" if done else "")


def _layer(state: dict[str, Any], done: dict[str, Any] | None) -> str:
    if done is None:
        return f"{state['lines_executed']} of {state['lines_total']} commands made"
    passes = " (passes)" if done["passes"] else ""
    text = f"{done['layer']} of {done['layers']}, {done['layers_done']} whole{passes}"
    if done["vessels"]:
        text += f"; vessel {done['vessel']} of {done['vessels']}"
    return text


def _ink(done: dict[str, Any] | None) -> str:
    if done is None:
        return _UNKNOWN
    left = done["ink_left_ul"]
    text = f"{done['ink_ul']:.1f} of {done['ink_total_ul']:.1f} µL written"
    return text if left is None else f"{text}, {left:.0f} µL left"


def _heat(station: dict[str, Any] | None) -> str:
    live = station is not None and station["state"] in OPEN
    temperatures = station["temperatures"] if station is not None and live else ()
    return ", ".join(map(_one, temperatures)) or _UNKNOWN


def _one(heater: dict[str, Any]) -> str:
    target = heater["target_c"]
    return f"{heater['name']} {heater['now_c']:.1f}" + (f" → {target:g} °C" if target else " °C")


def _tip(state: dict[str, Any], done: dict[str, Any] | None) -> str:
    if done is None or not state["position_known"]:
        return _UNKNOWN
    place = " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", done["tip_mm"], strict=True))
    return _RAISED.get(LinkState(state["state"]), "") + place


def _alarms(state: dict[str, Any]) -> str:
    count, again = state["alarms"], state["line_errors"]
    text = f"{count}: {state['last_alarm']}".removesuffix(": ") if count else "none"
    return f"{text}; {again} lines sent again" if again else text
