"""Reason text for refusing a G-code, often with the command to use instead."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

_COUNT: Final = "it would break the link's count or position"
_FIRMWARE: Final = (
    "it changes the firmware's settings, which the profile describes; close the station, set it "
    "with the maker's own program, then `printctl profiles probe` corrects the profile"
)
_LIMITS: Final = "it moves without the soft limits; use jog, move_to or home"
_FILES: Final = "it runs or writes files on the board that no check has seen; print from the host"
_WAITS: Final = "it waits for a button on the printer for ever; take it out and pause from the host"


def _each(why: str, names: str) -> dict[str, str]:
    return dict.fromkeys(names.split(), why)


REASONS: Final[dict[str, str]] = {
    **_each(_FIRMWARE, "M92 M201 M202 M203 M204 M205 M206 M207 M208 M209 M218 M301 M304 M305"),
    **_each(_FIRMWARE, "M307 M309 M350 M428 M500 M501 M502 M504 M569 M574 M584 M665 M666"),
    **_each(_FIRMWARE, "M851 M906 M907 M913 M915 M950 M558 M557 M561 M563 M572 M593 M671"),
    **_each(
        "it switches the firmware's own limits; they stay as they are built", "M211 M564 M120 M121"
    ),
    **_each(_LIMITS, "G2 G3 G5 G10 G11 G12 G26 G27 G29 G30 G32 G33 G34 G35 G38 G42 G60 G61 G76"),
    **_each(_LIMITS, "G80 G81 G425 M48 M125 M290 M423 M600 M603 M701 M702 M922"),
    **_each(_FILES, "M20 M21 M22 M23 M24 M25 M26 M27 M28 M29 M30 M32 M33 M36 M37 M38 M98 M928"),
    **_each(_FILES, "M997 M505 M470 M471"),
    "G20": "inches: the link's own moves are in mm; write millimetres",
    "G53": "another frame of places; the link knows one alone",
    "G91": "relative moves: a line sent again would move twice; write G90 and absolute X Y Z",
    "M83": "relative extrusion: a line sent again would dose twice; write M82 and absolute E",
    "G92": f"{_COUNT}; say where the tip is by `printctl station where`",
    "SET_KINEMATIC_POSITION": f"{_COUNT}; say where the tip is by `printctl station where`",
    "M0": _WAITS,
    "M1": _WAITS,
    "M17": f"{_COUNT}: motors are held by the station",
    "M18": f"{_COUNT}: motors without power lose their place",
    "M84": f"{_COUNT}: motors without power lose their place",
    "M85": "the link sets the firmware's own switch-off; see idle_timeout_s of the profile",
    "SET_IDLE_TIMEOUT": "the link sets the firmware's own switch-off; see idle_timeout_s",
    "M108": f"it breaks the printer's waits; {_COUNT}",
    "M110": f"it renumbers the lines, which the link does itself; {_COUNT}",
    "M111": "it may make the firmware run dry or silent; M111 alone asks for its flags",
    "M112": f"{_COUNT}; to halt the printer use `printctl station kill`",
    "M113": "the link sets how often the firmware says that it is busy",
    "M118": "its text would be taken for the printer's own answer; use M117",
    "M149": "temperatures are in °C",
    "M154": "the station asks for positions itself",
    "M155": "the station asks for temperatures itself",
    "M410": f"it throws moves away; {_COUNT}: `printctl station stop` ends a move",
    "M876": "it answers a prompt of the firmware; see to the printer",
    "M999": "it clears an error state that a person must see; reconnect instead",
    "M200": "E is the plunger's travel in mm, no volume",
    "M220": "speeds are the job's, within the profile's limits; a factor would pass them by",
    "M221": "doses are the job's; a factor would change them: correct `flow_factor` or the ink",
    "M302": "the link allows cold extrusion itself where the plunger moves",
    "M900": "pressure advance is the profile's advance_s; correct it there",
    "SET_PRESSURE_ADVANCE": "pressure advance is the profile's advance_s; correct it there",
    "SET_VELOCITY_LIMIT": "speed and acceleration are the profile's and printer.cfg's",
    "SET_GCODE_OFFSET": f"it shifts every place that is named later; {_COUNT}",
    "RESTORE_GCODE_STATE": "it brings back modes, and a place, that no check follows",
    "SAVE_GCODE_STATE": "what it saves no check follows",
    "SAVE_CONFIG": f"it restarts the firmware; {_COUNT}",
    "FIRMWARE_RESTART": f"it restarts the firmware; {_COUNT}: use reconnect",
    "RESTART": f"it restarts the firmware; {_COUNT}: use reconnect",
    **_each("it waits for a temperature, and nothing else is heard meanwhile; use heat",
            "M109 M190 M191 M116 TEMPERATURE_WAIT"),
    **_each("it heats without a limit; use heat", "M303 M568 M144 M143"),
    "M106": "a fan",
    "G4": "it keeps the printer from answering; nothing waits for it here",
    "G28": "homing drives the needle into what is below",
    "M400": "it stops the needle in the gel until the planner is empty; pause instead",
}  # fmt: skip
"""By code, without its number of a head."""

_IN_PRINT: Final[dict[str, str]] = {
    "M112": f"{_COUNT}; to halt the printer use `printctl kill`",
    "M410": f"it throws moves away; {_COUNT}: `printctl stop` ends the print",
    "G92": f"{_COUNT}, which a print takes from its start",
    "SET_KINEMATIC_POSITION": f"{_COUNT}, which a print takes from its start",
}
"""While a print goes on or is paused, where the station's commands don't reach."""

_NAMED: Final = (
    "macros and commands with names may move, heat or set anything, and no check here knows what "
    "they do"
)
_UNLISTED: Final = "it isn't on the list of what may be sent, so nobody judged what it does"


def reason(code: str, listed: Iterable[str], console: bool, in_print: bool = False) -> str:
    """Return why a code is refused; ``listed`` are the origins that may send it."""
    if in_print and code in _IN_PRINT:
        return _IN_PRINT[code]
    if code in REASONS:
        return REASONS[code]
    if code.startswith("T"):
        return (
            "another head than the job's would be taken; its syringe is changed by `printctl "
            "reload RUN --head`, which takes it and gives it back"
        )
    why = _NAMED if "_" in code or not code[1:].isdigit() else _UNLISTED
    return f"{why}. What may be sent from here: {', '.join(listed)}" if console else why
