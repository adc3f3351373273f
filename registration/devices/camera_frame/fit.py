"""Fit a camera's pose to the printer from insert marks, touched crosses and printed lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any, Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.devices.camera_frame.bundle import (
    Bundle,
    Fitted,
    Placement,
    PrintedPoints,
    Start,
    Touch,
    fit_bundle,
)
from registration.devices.camera_frame.frame import (
    Bath,
    CameraFrame,
    SeenAtFit,
    View,
    meet,
    turn_vector,
)
from registration.devices.camera_frame.insert import Insert
from registration.devices.camera_frame.marks import FEWEST, SeenMarks
from registration.devices.camera_frame.printed_lines import PrintedLine, find_crossings
from registration.devices.lens import Lens
from registration.errors import PictureError

U_TILT: Final = 0.005
"""Standard uncertainty of the plate's tilt against the printer's plane, rad, untouched."""
_AWAY: Final = 1e4
_MOVED_PX: Final = 0.5
"""Between pictures of one frame, in which nothing may move."""
_ALIKE: Final = 4.0
"""Ratio of errors up to which both poses that a plane allows are tried."""
_MISFIT_PX: Final = 1.0
"""RMS of the marks from which the insert may be bent."""
_WORST_TOUCH: Final = 4.0
_TOUCH_CHANCE: Final = 1e-3
_MARKS_OFF: Final = 2.0
_SHAPE_OFF: Final = 3.0
"""RMS of the marks' places, and of the plate's shape, of what their way of making leaves."""
_LONG: Final = 3.0
"""Focal length in sides of the picture that `fit_lens` takes where pictures can't tell it."""


@dataclass(frozen=True)
class Ties:
    """What ties an insert to the printer.

    Attributes
    ----------
    touches : sequence of Touch
        Two or more, or none.
    printed : PrintedPoints or None
    z_mm, u_z_mm : float, mm
        Height of the marks by a rule, and its standard uncertainty; touches tell it better.
    at_mm : (x, y), mm
        The insert's middle, where nothing else tells it; unturned then.
    bath : Bath, optional
        Above the printed points.

    Without touches and printed points the frame is the insert's own, moved to ``at_mm``.
    """

    touches: Sequence[Touch] = ()
    printed: PrintedPoints | None = None
    z_mm: float = 0.0
    u_z_mm: float = 0.2
    at_mm: tuple[float, float] = (0.0, 0.0)
    bath: Bath | None = None


def merged(pictures: Sequence[SeenMarks]) -> SeenMarks:
    """Mean of several pictures in which nothing moved.

    Raises
    ------
    PictureError
        When there is none, or something moved.
    """
    if not pictures:
        raise PictureError("no picture of the fiducial plate is given; give one or more")
    numbers = sorted(set.intersection(*(set(one.index.tolist()) for one in pictures)))
    if len(numbers) < FEWEST:
        raise PictureError(
            f"only {len(numbers)} marks are seen in all {len(pictures)} pictures ({FEWEST} "
            "wanted); keep hands and needle out of the view"
        )
    index = np.array(numbers, dtype=np.int64)
    rows = [np.searchsorted(one.index, index) for one in pictures]
    stack = np.stack([one.corners[row] for one, row in zip(pictures, rows, strict=True)])
    corners = stack.mean(axis=0)
    moved = float(np.linalg.norm(np.median(stack - corners, axis=(1, 2)), axis=1).max())
    if moved > _MOVED_PX:
        raise PictureError(
            f"between the pictures the fiducial plate or the camera moved by {moved:.1f} pixels "
            f"({_MOVED_PX:g} at most); fasten both, and take them again"
        )
    own = np.stack([one.u_px[row] for one, row in zip(pictures, rows, strict=True)])
    return SeenMarks(
        index,
        corners,
        np.sqrt((own**2).mean(axis=0) / len(pictures)),
        float(np.median([one.blur_px for one in pictures])),
        float(np.median([one.black for one in pictures])),
        float(np.median([one.white for one in pictures])),
        float(np.median([one.gamma for one in pictures])),
    )


def fit_frame(
    marks: SeenMarks, insert: Insert, lens: Lens, ties: Ties, made: datetime
) -> CameraFrame:
    """Fit pose, lens, insert and its place in the printer together.

    Parameters
    ----------
    marks : SeenMarks
        By `find_marks`, or `merged` of several.
    insert : Insert
    lens : Lens
        With its covariance, where the pictures of its board told it; else as `lens_factor` says.
    ties : Ties
    made : datetime
        When the pictures were taken.

    Raises
    ------
    PictureError
        When marks, lens and touches don't fit each other.
    """
    check_touches(insert, ties.touches)
    poses = _first_poses(marks, insert, lens)
    placement = _placed(ties, insert, lens, marks, poses[0])
    bath = None if ties.bath is None else (ties.bath.surface_z_mm, ties.bath.index)
    bundle = Bundle(
        insert, marks, lens.numbers, lens_factor(lens), placement, ties.touches, ties.printed, bath
    )
    fits = [fit_bundle(bundle, _moved(pose, placement)) for pose in poses]
    best = min(fits, key=lambda fitted: fitted.misfit)
    _refuse_misfits(best, insert, ties)
    return _frame(best, marks, insert, lens, ties, made)


def fit_printed_frame(
    image: NDArray[Any],
    lines: Sequence[PrintedLine],
    marks: SeenMarks,
    insert: Insert,
    lens: Lens,
    ties: Ties,
    made: datetime,
) -> tuple[CameraFrame, Ties]:
    """Fit a frame by the crossings of printed lines in a picture; return it, and its ties.

    The first fit, by ``ties`` alone, tells where to look for the lines.

    Raises
    ------
    PictureError
        As `fit_frame` and `find_crossings`.
    """
    first = fit_frame(marks, insert, lens, ties, made)
    ties = replace(ties, printed=find_crossings(image, first.view, lines))
    return fit_frame(marks, insert, lens, ties, made), ties


def frame_notes(frame: CameraFrame, insert: Insert, lens: Lens, ties: Ties) -> list[str]:
    """What a user should know of a fitted frame."""
    notes = []
    off = frame.middle_mm[2] - ties.z_mm
    if frame.tied == "printed" and abs(off) >= 3 * ties.u_z_mm:
        notes.append(
            f"the marks seem to lie {off:+.1f} mm from --at's Z ({ties.z_mm:g} ± {ties.u_z_mm:g} "
            "mm), and the frame is a compromise of both: leave --at out, or give the marks' height"
        )
    if lens.covariance is None:
        notes.append(
            "the lens file doesn't say how well its numbers are known; fit it to five pictures of "
            "a board, tilted by 20 to 40 degrees to different sides (printctl calibrate camera)"
        )
    if frame.tied == "insert":
        notes.append("places are the plate's, moved to --at: nothing ties them to the printer")
    if frame.off_px > _MISFIT_PX:
        notes.append(f"marks are off by {frame.off_px:.1f} pixels: is the fiducial plate flat?")
    scale = frame.insert_scale / insert.scale - 1
    if abs(scale) > 3 * insert.u_scale:
        notes.append(
            f"the fiducial plate is {100 * scale:+.2f} % larger than it should be; measure it"
        )
    return notes


def _refuse_misfits(best: Fitted, insert: Insert, ties: Ties) -> None:
    if best.marks_off > _MARKS_OFF or best.shape_off > _SHAPE_OFF:
        most = max(best.marks_off / _MARKS_OFF, best.shape_off / _SHAPE_OFF)
        raise PictureError(
            "the marks don't lie as on this fiducial plate: the plate is bent, stretched, or made "
            f"{most:.1f} times worse than {insert.process} ones may be, or the lens was "
            "calibrated at another focus or zoom. Is it this fiducial plate (--insert), made as it "
            "says (--made) and laid flat? Is it this focus (--lens)?"
        )
    if best.worst_touch > _WORST_TOUCH:
        raise PictureError(
            "the touched crosses don't fit the fiducial plate: one is off by "
            f"{best.worst_touch:.1f} of its standard uncertainties ({_WORST_TOUCH:g} at most). "
            "Touch again; are the names those on the fiducial plate (left, right, front, back as "
            "drawn), is it this fiducial plate, and was the lens calibrated at this focus?"
        )
    if best.touch_chance < _TOUCH_CHANCE:
        usual = 1e3 * float(np.mean([touch.u_mm for touch in ties.touches]))
        raise PictureError(
            "the touched crosses don't fit the fiducial plate: they scatter "
            f"{best.touch_misfit:.1f} times as much as touches good to {usual:.0f} µm. Touch "
            "again, or state what they are good to (--u-touch-mm); is the fiducial plate made as "
            "it says, and was the lens calibrated at this focus?"
        )


def check_touches(insert: Insert, touches: Sequence[Touch]) -> None:
    """Raise `PictureError` unless none or two and more crosses of the insert are touched."""
    names = [cross.name for cross in insert.crosses]
    for touch in touches:
        if touch.name not in names:
            raise PictureError(
                f"the fiducial plate has no cross {touch.name!r}; it has {', '.join(names)}"
            )
    if len({touch.name for touch in touches}) == 1:
        raise PictureError(
            "one touched cross doesn't say how the fiducial plate is turned; touch two or more, "
            "opposite ones"
        )


def lens_factor(lens: Lens) -> FloatArray:
    """Factor (8, 8) of the lens' covariance; where its file has none, of a wide one.

    Then the focal length is taken as known to 2 % (or, where it is the one that is taken when
    pictures can't tell it, to 50 %), the optical axis to 2 % of the side, and each term of the
    distortion so that it moves the picture's corner by 0.2 % of its distance.
    """
    if lens.covariance is not None:
        size, axes = np.linalg.eigh(np.array(lens.covariance))
        return np.asarray(axes * np.sqrt(np.maximum(size, 0.0)))
    side, focal = max(lens.size_px), lens.focal_px
    far = float(np.hypot(*lens.size_px)) / 2 / focal
    told = abs(focal / (_LONG * side) - 1) > 1e-9
    sure = [
        (0.02 if told else 0.5) * focal, 0.02 * side, 0.02 * side,
        2e-3 / far**2, 2e-3 / far**4, 1e-3 / far, 1e-3 / far, 2e-3 / far**6,
    ]  # fmt: skip
    factor = np.diag(sure)
    # The same bend in pixels is another number at another focal length.
    factor[3, 0] = 2 * lens.coefficients[0] * sure[0] / focal
    factor[4, 0] = 4 * lens.coefficients[1] * sure[0] / focal
    return factor


def _first_poses(marks: SeenMarks, insert: Insert, lens: Lens) -> list[Start]:
    """Poses over the insert's own frame: one, or both that a plane allows where they are alike."""
    plane = insert.scale * insert.corners()[marks.index].reshape(-1, 2)
    flat = (lens.straight_pixels(marks.corners.reshape(-1, 2)) - lens.centre_px) / lens.focal_px
    _, turns, ways, errors = cv2.solvePnPGeneric(
        np.column_stack([plane, 0 * plane[:, 0]]), flat, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    starts = []
    for turn, way, error in zip(turns, ways, np.ravel(errors), strict=True):
        matrix = np.asarray(cv2.Rodrigues(turn)[0])
        eye = -matrix.T @ np.ravel(way)
        if eye[2] > 0:
            starts.append((float(error), Start(matrix, eye)))
    if not starts:
        raise PictureError("the marks are seen from below; is the picture mirrored?")
    starts.sort(key=lambda pair: pair[0])
    return [pose for error, pose in starts if error < _ALIKE * starts[0][0]]


def _moved(pose: Start, placement: Placement) -> Start:
    """The pose in the frame in which the insert is placed."""
    c, s = np.cos(placement.turned_rad), np.sin(placement.turned_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Start(pose.turn @ turn.T, np.array(placement.origin_mm) + turn @ pose.eye_mm)


def _placed(ties: Ties, insert: Insert, lens: Lens, marks: SeenMarks, pose: Start) -> Placement:
    """First guess of where the insert lies, and how little that is taken as known."""
    if ties.touches:
        names = {cross.name: (cross.x_mm, cross.y_mm) for cross in insert.crosses}
        own = np.array([names[touch.name] for touch in ties.touches])
        there = np.array([(touch.x_mm, touch.y_mm) for touch in ties.touches])
        heights = [touch.z_mm for touch in ties.touches if touch.z_mm is not None]
        z = float(np.mean(heights)) if heights else ties.z_mm
        known = len(heights) > 0
    elif ties.printed is not None:
        below = ties.printed.places_mm[:, 2] - ties.z_mm
        bath = () if ties.bath is None else (ties.bath.surface_z_mm - ties.z_mm, ties.bath.index)
        view = View(lens.numbers, pose.turn, pose.eye_mm, *bath)
        own, there = meet(view, ties.printed.pixels, below), ties.printed.places_mm[:, :2]
        z, known = ties.z_mm, False
    else:
        return Placement(origin_mm=(*ties.at_mm, ties.z_mm))
    shift, angle = _rigid(own, there)
    return Placement(
        (float(shift[0]), float(shift[1]), z), angle, _AWAY, _AWAY if known else ties.u_z_mm,
        _AWAY, U_TILT,
    )  # fmt: skip


def _rigid(own: FloatArray, there: FloatArray) -> tuple[FloatArray, float]:
    """Shift of the origin and turn that lay points (n, 2) on others, least squares."""
    a, b = own - own.mean(axis=0), there - there.mean(axis=0)
    angle = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    c, s = np.cos(angle), np.sin(angle)
    return there.mean(axis=0) - np.array([[c, -s], [s, c]]) @ own.mean(axis=0), angle


def _frame(
    fitted: Fitted, marks: SeenMarks, insert: Insert, lens: Lens, ties: Ties, made: datetime
) -> CameraFrame:
    numbers = fitted.view.lens
    own = tuple(tuple(map(float, row)) for row in fitted.covariance)
    lens = lens.model_copy(
        update={
            "focal_px": float(numbers[0]),
            "centre_px": (float(numbers[1]), float(numbers[2])),
            "distortion": tuple(map(float, numbers[3:])),
            "covariance": tuple(row[6:] for row in own[6:]),
        }
    )
    plane = np.column_stack([fitted.marks_mm[:, :2], np.ones(len(fitted.marks_mm))])
    drawn = insert.corners().mean(axis=1)
    level = np.linalg.lstsq(plane, fitted.marks_mm[:, 2], rcond=None)[0]
    origin = np.linalg.lstsq(
        np.column_stack([drawn, np.ones(len(drawn))]), fitted.marks_mm, rcond=None
    )[0][2]
    tied: Literal["insert", "touched", "printed"] = (
        "touched" if ties.touches else "insert" if ties.printed is None else "printed"
    )
    seen = SeenAtFit(
        numbers=tuple(insert.numbers[n] for n in marks.index),
        corners_px=tuple(tuple(map(float, corner.ravel())) for corner in marks.corners),
        u_px=float(np.sqrt((marks.u_px**2).mean()) * max(1.0, fitted.misfit)),
        blur_px=marks.blur_px,
        black=marks.black,
        white=marks.white,
        gamma=marks.gamma,
    )
    return CameraFrame(
        made=made,
        tied=tied,
        lens=lens,
        turn_vector=_three(turn_vector(fitted.view.turn)),
        eye_mm=_three(fitted.view.eye_mm),
        covariance=own,
        middle_mm=_three(origin),
        insert=insert,
        marks_z_slope=(float(level[0]), float(level[1])),
        seen=seen,
        off_px=fitted.off_px,
        insert_scale=fitted.scale,
        bath=ties.bath,
    )


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z
