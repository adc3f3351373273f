"""Validate and re-encode uploaded photos of a print."""

from __future__ import annotations

import io
import time
from pathlib import Path
from typing import Final

from PIL import Image, ImageOps

from design.files import write_bytes
from printctl.web.errors import BadRequestError, NotFoundError
from printctl.web.workspace import checked_name

MOST_BYTES: Final = 30_000_000
_MOST_PIXELS: Final = 100_000_000
_LONGEST: Final = 2560
_FORMATS: Final = ("JPEG", "PNG", "WEBP", "TIFF")


def keep_photo(folder: Path, data: bytes) -> str:
    """Write a picture as JPEG, without what else was in its file; give its name.

    Raises
    ------
    BadRequestError
        When it is too large or no picture.
    """
    if len(data) > MOST_BYTES:
        raise BadRequestError(
            f"the photo has {len(data) / 1e6:.0f} MB, more than {MOST_BYTES / 1e6:g} MB; make it "
            "smaller"
        )
    try:
        with Image.open(io.BytesIO(data), formats=_FORMATS) as seen:
            if seen.width * seen.height > _MOST_PIXELS:
                raise BadRequestError(
                    f"the photo has {seen.width} x {seen.height} pixels, more than "
                    f"{_MOST_PIXELS / 1e6:g} million; make it smaller"
                )
            seen.verify()
        with Image.open(io.BytesIO(data), formats=_FORMATS) as read:
            picture = ImageOps.exif_transpose(read).convert("RGB")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as exc:
        raise BadRequestError(
            "that is no picture that can be read (JPEG, PNG, WebP or TIFF)"
        ) from exc
    picture.thumbnail((_LONGEST, _LONGEST))
    out = io.BytesIO()
    picture.save(out, "JPEG", quality=88)
    name = f"{time.strftime('%Y%m%d-%H%M%S', time.gmtime())}-{time.monotonic_ns() % 10**6:06d}.jpg"
    write_bytes(folder / name, out.getvalue())
    return name


def photo_file(folder: Path, name: str) -> Path:
    """File of a photo.

    Raises
    ------
    NotFoundError, BadRequestError
    """
    path = folder / checked_name(name)
    if path.suffix != ".jpg" or not path.is_file():
        raise NotFoundError(f"there is no photo {name!r} of this print")
    return path
