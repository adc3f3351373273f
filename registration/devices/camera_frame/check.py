"""Check by the marks in one new picture if a calibrated camera or insert has moved."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.devices.camera_frame.frame import CameraFrame
from registration.devices.camera_frame.marks import FEWEST, SeenMarks, find_marks
from registration.errors import PictureError

LIMIT_UM: Final = 30.0
"""Shift at the dish up to which a frame holds: what it is good for itself."""
_NOTED_UM: Final = 10.0
_SURE: Final = 4.0
"""Shift that is told though the frame holds, and of its standard uncertainties."""
_BLURRED: Final = (1.6, 0.6)
"""Blur of then times the first and pixels more: another focus."""
_FAINT: Final = 0.4
"""Contrast of black and white over that of then: another exposure or light."""
_BRIGHT: Final = 0.995
_ALONE_UM: Final = 60.0
"""A single mark's shift against the others': it is dirty, glared upon or loose."""


@dataclass(frozen=True)
class FrameCheck:
    """Answer of `check_frame`.

    Attributes
    ----------
    holds : bool
    moved_um : float, µm
        Largest shift of what is seen within the dish, at the marks' height; NaN where it can't be
        told.
    u_um : float, µm
        Its standard uncertainty, at the worst place of the dish.
    marks : int
        Marks that were compared.
    why : tuple of str
        Reasons why it doesn't hold; empty where it does.
    notes : tuple of str
        What else differs.
    """

    holds: bool
    moved_um: float
    u_um: float
    marks: int
    why: tuple[str, ...]
    notes: tuple[str, ...] = ()


def check_frame(
    image: NDArray[Any],
    frame: CameraFrame,
    source: Path | str = "the picture",
    limit_um: float = LIMIT_UM,
) -> FrameCheck:
    """Compare the marks of a picture with those of the frame's own pictures.

    Marks may be hidden; `FEWEST` must be seen. A shift is laid smoothly over the dish between
    them, so that a single mark's fault moves nothing. Whether camera or insert moved one picture
    can't tell; the frame is good for neither.

    Parameters
    ----------
    image : (h, w) or (h, w, 3)
    frame : CameraFrame
    source : Path or str
        Named in messages.
    limit_um : float, µm
        Shift up to which it holds.
    """
    try:
        marks = find_marks(image, frame.insert, frame.lens, source)
    except PictureError as exc:
        return FrameCheck(False, float("nan"), float("nan"), 0, (str(exc),))
    numbers = [frame.insert.numbers[n] for n in marks.index]
    both = [n for n in numbers if n in frame.seen.numbers]
    if len(both) < FEWEST:
        few = f"{source}: {len(both)} marks are seen that the frame knows ({FEWEST} wanted)"
        return FrameCheck(False, float("nan"), float("nan"), len(both), (few,))
    now = marks.corners[[numbers.index(n) for n in both]]
    then = frame.seen.corners[[frame.seen.numbers.index(n) for n in both]]
    shifts = _Shifts(frame, then, now, both)
    why, notes = _optics(marks, frame)
    if shifts.moved_um > limit_um:
        why.insert(0, f"{shifts.words()} ({limit_um:g} µm at most); fasten it, and fit the frame "
                      "anew (printctl observe frame)")  # fmt: skip
    elif shifts.moved_um + 2 * shifts.u_um > limit_um:
        why.insert(0, f"{len(both)} marks on one side don't tell a shift of {limit_um:g} µm (± "
                      f"{2 * shifts.u_um:.0f} µm); uncover more")  # fmt: skip
    elif shifts.moved_um > max(_NOTED_UM, _SURE * shifts.u_um):
        notes.append(f"{shifts.words()}; up to {limit_um:g} µm are taken")
    if shifts.odd:
        told = ", ".join(map(str, shifts.odd))
        notes.append(f"marks that differ from the others: {told}; wipe them")
    return FrameCheck(not why, shifts.moved_um, shifts.u_um, len(both), tuple(why), tuple(notes))


class _Shifts:
    """Shift over the dish by a robust affine fit of the marks' shifts."""

    def __init__(
        self, frame: CameraFrame, then: FloatArray, now: FloatArray, numbers: list[int]
    ) -> None:
        view, z = frame.under(None), frame.middle_mm[2]
        middle = np.array(frame.middle_mm[:2])
        was = view.to_printer(then.mean(axis=1), z) - middle
        self.shift = 1e3 * (view.to_printer(now.mean(axis=1), z) - middle - was)
        terms = np.column_stack([np.ones(len(was)), was / 30.0])
        weight = np.ones(len(was))
        for _ in range(20):
            self.fit = np.linalg.lstsq(
                terms * weight[:, None], self.shift * weight[:, None], rcond=None
            )[0]
            off = np.linalg.norm(self.shift - terms @ self.fit, axis=1)
            usual = max(float(np.median(off)), 0.5)
            weight = np.sqrt(1 / (1 + (off / (3 * usual)) ** 2))
        self.odd = [n for n, far in zip(numbers, off, strict=True) if far > _ALONE_UM]
        field = view.to_printer(frame.field(), z) - middle
        asked = np.column_stack([np.ones(len(field)), field / 30.0])
        moved = np.linalg.norm(asked @ self.fit, axis=1)
        self.moved_um = float(moved.max())
        noise = max(1.2 * usual, frame.seen.u_px * frame.um_per_px)
        # Marks in one line say nothing beside it: its uncertainty is huge then, not none.
        inner = np.linalg.inv(terms.T @ (terms * (weight**2)[:, None]) + 1e-6 * np.eye(3))
        spread = np.sqrt(np.einsum("ni,ij,nj->n", asked, inner, asked))
        self.u_um = float(noise * spread.max())

    def words(self) -> str:
        """What moved, in words."""
        x, y = self.fit[0]
        slope = 1e-3 * self.fit[1:].T / 30.0
        cosine, sine = 2.0 + slope[0, 0] + slope[1, 1], slope[1, 0] - slope[0, 1]
        turn = np.degrees(np.arctan2(sine, cosine))  # of a picture upside down, too
        grown = 100.0 * (np.hypot(cosine, sine) / 2 - 1.0)
        said = (
            f"camera or fiducial plate moved: {self.moved_um:.0f} µm at the dish (x {x:+.0f}, y "
            f"{y:+.0f}"
        )
        if abs(turn) > 0.02:
            said += f", turned {turn:+.2f} degrees"
        if abs(grown) > 0.1:
            said += f", {grown:+.2f} % larger: zoom, focus or height changed"
        return said + ")"


def _optics(marks: SeenMarks, frame: CameraFrame) -> tuple[list[str], list[str]]:
    """Reasons and notes by blur and brightness."""
    why: list[str] = []
    notes: list[str] = []
    then = frame.seen
    if marks.blur_px > _BLURRED[0] * then.blur_px + _BLURRED[1]:
        why.append(
            f"edges are blurred over {marks.blur_px:.1f} pixels, {then.blur_px:.1f} when the frame "
            "was fitted: the focus changed, or the camera shakes"
        )
    contrast, before = marks.white - marks.black, then.white - then.black
    if contrast < _FAINT * before or marks.white > _BRIGHT > then.white:
        why.append(
            f"black and white of the marks are {marks.black:.2f} and {marks.white:.2f} of the "
            f"range, {then.black:.2f} and {then.white:.2f} when the frame was fitted: set exposure "
            "and light as then"
        )
    elif abs(contrast / before - 1) > 0.25:
        notes.append(f"exposure or light changed: contrast {contrast / before:.0%} of then")
    return why, notes
