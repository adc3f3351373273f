"""Write the playback of a predicted print as a separate HTML page."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from design.files import write_text
from registration.gcode_job import Act
from report.page_frame import render
from report.play.playback import Playback
from report.play.section import clock, play_section
from report.wording import number


def write_play_html(path: Path, played: Playback, title: str) -> None:
    """Write the slider as one HTML file that opens offline.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    played : Playback
    title : str

    Raises
    ------
    OSError
        When the file can't be written.
    """
    section = play_section(played)
    context = {
        "title": title,
        "facts": _facts(played),
        "play": section.context,
    }
    write_text(path, render("play.html", context, section.entry, section.styles))


def _facts(played: Playback) -> list[str]:
    """A few numbers for the top of the page."""
    rows, noun = played.rows, "passes" if played.passes else "layers"
    writes = rows.act == Act.WRITE
    written = float(np.where(writes, rows.way_mm, 0.0).sum())
    return [
        ", ".join(name for name in played.inks if name),
        f"{number(len(played.layer_z_mm))} {noun}",
        f"{number(written / 1e3, 3)} m written",
        f"{number(float(rows.laid_ul[-1]), 4)} µL laid",
        f"{clock(played.duration_s)} by the firmware's planner",
    ]
