"""Playback of a predicted print by time slider: HTML page or report section.

Goes in: predicted ink in order of time. Comes out: a page with a slider. Begin with `playback.py`.
"""

from report.play.file import load_played, save_played
from report.play.page import write_play_html
from report.play.playback import Playback, PlayNote, PlayRows
from report.play.section import play_section
from report.play.thin import Limits, thin_playback

__all__ = [
    "Limits",
    "PlayNote",
    "PlayRows",
    "Playback",
    "load_played",
    "play_section",
    "save_played",
    "thin_playback",
    "write_play_html",
]
