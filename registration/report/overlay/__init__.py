"""Pictures and page of a scan overlaid on the G-code."""

from registration.report.overlay.figure import PictureOf, draw_overlay
from registration.report.overlay.page import OverlayPage, write_overlay_html

__all__ = ["OverlayPage", "PictureOf", "draw_overlay", "write_overlay_html"]
