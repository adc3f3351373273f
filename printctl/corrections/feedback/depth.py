"""Decide if a compensation may correct z: only with a depth standard and a fitted depth scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from printctl.corrections.feedback.evidence import Print


@dataclass(frozen=True)
class Depth:
    """Decision on correcting z, with its reason.

    Attributes
    ----------
    corrected : bool
    said : str
        A sentence for the file and the report.
    """

    corrected: bool
    said: str


def depth_of(prints: Sequence[Print], standard: str | None) -> Depth:
    """Decide for prints that are pooled.

    In OCT, shrinkage in depth and an error of the refractive index look the same, however much
    depth there is to fit. That a scale was fitted is therefore no reason to correct it.

    Parameters
    ----------
    prints : sequence of Print
    standard : str or None
        The user's own word for what stands behind the depth, of scans that don't say.
    """
    bare = [p.name for p in prints if not p.found["measured_by"]["depth_standard"]]
    unfitted = [p.name for p in prints if not p.found["depth_scale_fitted"]]
    if bare and standard is None:
        return Depth(
            False,
            f"Depth (z) is left as it was: no depth standard stands behind the scan of {bare[0]}"
            f"{_more(bare)}, so its scale in depth may be the refractive index' or the scanner's. "
            "Calibrate with a step of known height (printctl calibrate oct, then register "
            "--oct-calibration), or name the standard (compensate --depth-standard).",
        )
    if unfitted:
        return Depth(
            False,
            f"Depth (z) is left as it was: too little depth was in view to fit its scale "
            f"({unfitted[0]}{_more(unfitted)}).",
        )
    what = "the scans' calibration" if not bare else f"the user's word: {standard}"
    return Depth(True, f"Depth (z) is corrected; its standard: {what}.")


def _more(names: Sequence[str]) -> str:
    return f" and {len(names) - 1} more" if len(names) > 1 else ""
