"""Location of a print's time-lapse: beside its journal, named by the print's start time."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

TIMELAPSE: Final = "timelapse"


def frames_folder(folder: Path, started: float) -> Path:
    """Folder of the pictures ``000001.jpg`` and so on.

    Parameters
    ----------
    folder : Path
        The print's.
    started : float
        Wall-clock time, s since 1970, as the journal says.
    """
    return folder / TIMELAPSE / time.strftime("%Y%m%d-%H%M%S", time.gmtime(started))


def film_file(folder: Path, started: float) -> Path:
    """The film made of them; there only once the print has ended."""
    frames = frames_folder(folder, started)
    return frames.with_name(frames.name + ".webp")
