"""Pictures of a scan's layers overlaid on the G-code, and their HTML page.

Goes in: an overlay's numbers and pixels. Comes out: HTML, and a picture of each layer. Begin with
`page.py`.
"""

from report.overlay.figure import PictureOf, draw_overlay
from report.overlay.page import OverlayPage, write_overlay_html

__all__ = ["OverlayPage", "PictureOf", "draw_overlay", "write_overlay_html"]
