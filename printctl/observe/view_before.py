"""Find the picture that a print's look before has left: it shows what the new ink lies on."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from printctl.observe.observer import Look
from printctl.observe.records import LOOKS, read_looks

_OLDEST_S: Final = 3600.0
"""A picture that is older shows ink and bath as they were before they dried."""


def picture_before(folder: Path, begun: float, look: Look, now: Path) -> Path | None:
    """Return the picture of the look that directly precedes one; None where there is none.

    Parameters
    ----------
    folder : Path
        The print's.
    begun : float, s since 1970
        Of the print: what earlier prints left in the folder isn't of it.
    look : Look
    now : Path
        The picture that is to be judged, of the same kind.
    """
    own = [one for one in read_looks(folder, begun) if one.number < look.number]
    if not own or own[-1].done != look.before:
        return None
    path = folder / LOOKS / f"{own[-1].number:04d}" / f"picture{now.suffix}"
    try:
        age = now.stat().st_mtime - path.stat().st_mtime
    except OSError:
        return None
    return path if 0.0 <= age < _OLDEST_S else None
