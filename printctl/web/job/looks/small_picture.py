"""Re-encode an inspection's picture as a JPEG small enough for a page."""

from __future__ import annotations

import io
from functools import lru_cache
from pathlib import Path
from typing import Final

from PIL import Image

_KEPT: Final = 64
_FORMATS: Final = ("PNG", "JPEG", "TIFF", "WEBP", "BMP")


@lru_cache(maxsize=_KEPT)
def small_picture(path: Path, changed_ns: int, width_px: int) -> bytes | None:
    """Return a picture as JPEG, at most so wide; None where it can't be read.

    Parameters
    ----------
    path : Path
    changed_ns : int
        When the file was changed last: another time is another picture.
    width_px : int
    """
    del changed_ns
    try:
        with Image.open(path, formats=_FORMATS) as seen:
            picture = seen.convert("RGB")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None
    if picture.width > width_px:
        high = max(1, round(picture.height * width_px / picture.width))
        picture = picture.resize((width_px, high), Image.Resampling.LANCZOS, reducing_gap=2.0)
    out = io.BytesIO()
    picture.save(out, "JPEG", quality=85)
    return out.getvalue()
