"""Build the report page's section that plays back a predicted print."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Final

from markupsafe import Markup

from report.gcode.page import GCODE_STATIC
from report.play.frame import draw_frame
from report.play.playback import Playback
from report.play.serialise import pack_playback
from report.sections.added import AddedSection

_STATIC: Final = Path(__file__).parent / "static"
ENTRY: Final = 'import "play/main";'


def play_section(played: Playback) -> AddedSection:
    """The slider for the report's page."""
    # The switches and colours of ways are those of the G-code's page.
    styles = (GCODE_STATIC / "gcode.css", _STATIC / "play.css")
    return AddedSection(_context(played), ENTRY, styles)


def _context(played: Playback) -> dict[str, object]:
    picture, said = draw_frame(played)
    ordered = sorted(played.warnings, key=lambda one: (one.time_s is None, one.time_s or 0.0))
    return {
        "data": pack_playback(played),
        "noun": "Pass" if played.passes else "Layer",
        "passes": played.passes,
        "frame": Markup("data:image/png;base64," + base64.b64encode(picture).decode("ascii")),
        "frame_said": said,
        "warnings": [
            {
                "text": one.text,
                "line": one.line,
                "time_s": one.time_s,
                "clock": None if one.time_s is None else clock(one.time_s),
                "share": None
                if one.time_s is None
                else round(100 * one.time_s / max(played.duration_s, 1e-9), 3),
            }
            for one in ordered
        ],
        "notes": played.notes,
    }


def clock(seconds: float) -> str:
    """As the page's clock shows it: 1:02:03, or 2:03.4 below an hour."""
    tenths = round(10 * seconds)
    minutes, rest = divmod(tenths, 600)
    if minutes >= 60:
        return f"{minutes // 60}:{minutes % 60:02d}:{rest // 10:02d}"
    return f"{minutes}:{rest // 10:02d}.{rest % 10}"
