"""Filaments in a bath: of several widths and depths, short ones, glints, one over another."""

import cv2
import numpy as np
import pytest

from kernels.arrays import FloatArray
from printctl.inspection import LayerFindings, SeeingOptions, see_layer
from tests.printctl.inspection.painted import Flat, lines_of
from tests.slower import first_of

PX_MM, COARSE_MM = 0.02, 0.025
WIDTH = np.array([0.5, 0.35, 0.3])
DARK = np.array([0.8, 0.4, 0.22])
"""Logarithm in the middle: thick and shallow to thin and deep."""
START = np.array([[1.0, 1.0, -0.5], [1.0, 2.5, -1.5], [1.0, 4.0, -2.5]])
END = np.array([[5.0, 1.4, -0.5], [5.0, 2.9, -1.5], [5.0, 4.4, -2.5]])


def _look(
    bare: dict[int, tuple[float, float]] | None = None, end: FloatArray = END
) -> LayerFindings:
    """Findings of a picture in which some filaments are bare from and to, mm along them."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:280, 0:320] * PX_MM
    texture = cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 2.0)
    logs = np.log(140.0) + 0.02 * texture[..., None] / texture.std() * np.ones(3)
    hues = np.array([[0.2, 0.7, 1.0], [0.25, 0.75, 1.0], [0.3, 0.8, 1.0]])  # haze takes colour away
    for number, (begin, stop) in enumerate(zip(START[:, :2], END[:, :2], strict=True)):
        length = float(np.linalg.norm(stop - begin))
        way = (stop - begin) / length
        along = (x - begin[0]) * way[0] + (y - begin[1]) * way[1]
        across = (x - begin[0]) * way[1] - (y - begin[1]) * way[0]
        thick = np.sqrt(np.clip(1.0 - (2.0 * across / WIDTH[number]) ** 2, 0.0, 1.0))
        low, high = (bare or {}).get(number, (9.0, 9.0))
        own = (along > 0) & (along < length) & ~((along > low) & (along < high))
        logs -= DARK[number] * (thick * own)[..., None] * hues[number]
    light = cv2.GaussianBlur(np.exp(logs), (0, 0), 1.0) + rng.normal(0, 1.0, logs.shape)
    lines = lines_of(START, end, WIDTH)
    return see_layer(np.clip(light, 0, 255).astype(np.uint8), Flat(PX_MM), lines)


def _unseen_mm(found: LayerFindings, stroke: int = 0, low: float = 0.0, high: float = 9.0) -> float:
    """Way of a stroke that isn't seen, between two places along it and off its ends."""
    at = found.stations
    half, end = at.length_mm / 2, at.along_mm[at.stroke == stroke].max()
    own = (at.stroke == stroke) & (at.along_mm > max(low, 0.2)) & (at.along_mm < min(high, end))
    return float((2 * half)[own & ~at.seen & (at.along_mm < end - 0.2)].sum())


def test_sound_filaments_of_all_depths_are_seen() -> None:
    found = _look()
    assert found.gaps == ()
    assert found.seen_share > 0.9  # ends recede
    assert found.coverage > 0.95


@pytest.mark.parametrize("number", first_of([1, 0, 2]))
@pytest.mark.parametrize("bare", [(1.5, 2.3), (-1.0, 9.0)], ids=["gap", "all of it"])
def test_missing_ink_of_any_depth_is_found(number: int, bare: tuple[float, float]) -> None:
    found = _look({number: bare})
    (gap,) = found.gaps
    assert gap.stroke == number
    begin, end = max(bare[0], 0.0), min(bare[1], 4.02)
    assert (gap.from_mm, gap.to_mm) == pytest.approx((begin, end), abs=0.1)


def _faint(
    dark: float, seed: int, bare: tuple[float, float] | None = None, before: bool = True
) -> LayerFindings:
    """Findings of one faint filament of 5 mm; with glints that moved since the picture before."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:280, 0:380] * PX_MM
    texture = cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 2.0)
    bath = np.log(140.0) + 0.05 * (x / 7.0) ** 2 + 0.02 * texture / texture.std()
    thick = np.sqrt(np.clip(1.0 - (2.0 * (y - 2.5) / 0.4) ** 2, 0.0, 1.0))
    low, high = bare or (9.0, 9.0)
    ink = bath - dark * thick * ((x > 1.0) & (x < 6.0) & ~((x > low) & (x < high)))
    pictures = []
    for moved, logs in ((0.0, bath), (0.06, ink)):
        glint = 400.0 * np.exp(-(((x - 5.0 - moved) ** 2 + (y - 4.5 - moved) ** 2) / 0.2**2))
        light = cv2.GaussianBlur(np.exp(logs) + glint, (0, 0), 1.0)
        pictures.append(np.clip(light + rng.normal(0, 1.5, x.shape), 0, 255).astype(np.uint8))
    lines = lines_of([[1.0, 2.5, -1.0]], [[6.0, 2.5, -1.0]], 0.4)
    return see_layer(pictures[1], Flat(PX_MM), lines, before=pictures[0] if before else None)


@pytest.mark.parametrize("bare", [(2.6, 4.1), (3.5, 6.1)], ids=["1.5 mm", "half"])
@pytest.mark.parametrize("seed", first_of([1, 2, 3]))
def test_missing_ink_of_a_lone_faint_filament_is_found(seed, bare):
    found = _faint(0.04, seed, bare)
    (gap,) = found.gaps
    begin, end = bare[0] - 1.0, min(bare[1] - 1.0, 5.0)
    assert (gap.from_mm, gap.to_mm) == pytest.approx((begin, end), abs=0.3)


def test_what_is_too_faint_is_not_seen_over_its_whole_length() -> None:
    found = _faint(0.006, 7, (3.5, 6.1))
    assert found.gaps == ()
    assert found.seen_share == 0.0
    assert _unseen_mm(_faint(0.1, 7)) == 0.0


# Short filaments, and thin ones that join thick ones, among older ones.


Piece = tuple[float, float, float, float, float, float]
"""Begin and end, width, darkness."""


def _short(
    pieces: list[Piece],
    stroke: list[int],
    fresh: list[bool],
    bare: tuple[float, float] = (9.0, 9.0),
    rough: float = 0.03,
) -> LayerFindings:
    """Findings of filaments; ``bare`` of the last piece, mm along it."""
    rng = np.random.default_rng(4)
    y, x = np.mgrid[0:240, 0:280] * COARSE_MM
    texture = cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 3.0)
    dark = np.zeros(x.shape)
    for number, (x0, y0, x1, y1, width, strength) in enumerate(pieces):
        way = np.array([x1 - x0, y1 - y0])
        length = float(np.linalg.norm(way))
        along = ((x - x0) * way[0] + (y - y0) * way[1]) / length
        across = ((x - x0) * way[1] - (y - y0) * way[0]) / length
        beyond = np.maximum(np.maximum(-along, along - length), 0.0)
        own = strength * np.sqrt(
            np.clip(1.0 - (across**2 + beyond**2) / (width / 2) ** 2, 0.0, 1.0)
        )
        if number == len(pieces) - 1:
            own[(along > bare[0]) & (along < bare[1])] = 0.0
        dark = np.maximum(dark, own)
    logs = np.log(140.0) + rough * texture / texture.std() - dark
    logs = logs[..., None] - dark[..., None] * np.array([0.3, 0.1, 0.0])
    light = cv2.GaussianBlur(np.exp(logs), (0, 0), 1.0) + rng.normal(0, 1.0, logs.shape)
    at = np.array(pieces)
    z = np.where(at[:, 5] > 0.5, 3.0, 2.0)
    ends = (np.column_stack([at[:, k : k + 2], z]) for k in (0, 2))
    lines = lines_of(*ends, at[:, 4], stroke=stroke, fresh=fresh)
    options = SeeingOptions(shift_mm=0.2)
    return see_layer(
        np.clip(light, 0, 255).astype(np.uint8), Flat(COARSE_MM), lines, options=options
    )


OLDER: list[Piece] = [(1.0, 1.0, 6.0, 1.3, 0.5, 0.8), (1.0, 5.0, 6.0, 4.8, 0.5, 0.7)]
SHORT: Piece = (2.5, 3.0, 3.4, 3.1, 0.6, 0.8)


def test_a_short_filament_that_plainly_shows_has_no_gap() -> None:
    """It is hardly longer than its ends, which aren't judged by themselves."""
    found = _short([*OLDER, SHORT], [0, 1, 2], [False, False, True])
    assert found.gaps == ()
    assert found.contrast > 10.0


@pytest.mark.parametrize("bare", [(-1.0, 9.0), (0.45, 9.0)], ids=["all of it", "half"])
def test_a_short_filament_that_lacks_ink_is_not_passed(bare: tuple[float, float]) -> None:
    found = _short([*OLDER, SHORT], [0, 1, 2], [False, False, True], bare)
    assert found.gaps or not found.stations.seen.any()


SHORT_LONE: Piece = (2.5, 3.0, 3.7, 3.15, 0.35, 0.8)
"""1.2 mm long."""


@pytest.mark.parametrize("bare", [(0.45, 0.8), (-1.0, 0.55), (0.6, 9.0)])
def test_a_gap_of_a_short_filament_alone_in_a_bath_is_found(bare: tuple[float, float]) -> None:
    """It left too few places with ink, and its rims made them scatter: nothing was told."""
    (gap,) = _short([SHORT_LONE], [0], [True], bare).gaps
    ends = max(bare[0], 0.0), min(bare[1], 1.21)
    assert (gap.from_mm, gap.to_mm) == pytest.approx(ends, abs=0.1)


@pytest.mark.parametrize("rough", [0.03, 0.1])
def test_a_sound_short_filament_alone_in_a_bath_is_seen(rough: float) -> None:
    found = _short([SHORT_LONE], [0], [True], rough=rough)
    assert found.gaps == ()
    assert _unseen_mm(found) == 0.0


# Glints: ink that plainly shows in their light, and gaps beside them.


MIDDLE = 3.0
"""Of the filament on which a glint lies, mm along it."""


def seen(dark=0.5, bare=None, glint=(0.0, 0.13), light=130.0) -> LayerFindings:
    """Findings of three filaments of 6 mm, ``dark`` (or light) ones; the first may be bare.

    ``glint``: how far from its middle line, and its size, mm.
    """
    rng = np.random.default_rng(5)
    y, x = np.mgrid[0:240, 0:320] * COARSE_MM
    ink = np.zeros(x.shape)
    rows = (1.5, 3.0, 4.5)
    for number, row in enumerate(rows):
        spans = [(1.0, 7.0)]
        if number == 0 and bare is not None:
            spans = [(1.0, 1.0 + bare[0] - 0.2), (1.0 + bare[1] + 0.2, 7.0)]
        for low, high in spans:
            off = np.hypot(x - np.clip(x, low, high), y - row)
            ink = np.maximum(ink, np.sqrt(np.clip(1 - (off / 0.2) ** 2, 0, None)))
    plane = light * np.exp(-dark * ink)[..., None] * np.array([0.9, 1.0, 1.0])
    far, size = glint
    near = (x - 1.0 - MIDDLE) ** 2 + (y - rows[0] - far) ** 2
    plane = plane + 450.0 * np.exp(-near / (2 * size**2))[..., None]
    picture = cv2.GaussianBlur(plane, (0, 0), 1.0) + rng.normal(0, 1.5, plane.shape)
    lines = lines_of([(1.0, row, 2.0) for row in rows], [(7.0, row, 2.0) for row in rows], 0.4)
    options = SeeingOptions(shift_mm=0.2)
    return see_layer(
        np.clip(picture, 0, 255).astype(np.uint8), Flat(COARSE_MM), lines, options=options
    )


@pytest.mark.parametrize("far", [0.0, 0.15])
def test_no_more_than_a_glint_is_not_seen(far: float) -> None:
    """Of 200 sound looks 11 were asked about, nearly all because of glints."""
    found = seen(glint=(far, 0.13))
    assert not found.gaps
    # What is saturated isn't seen: five stations of 0.25 mm at most.
    assert 0.2 < _unseen_mm(found) <= 1.25


@pytest.mark.parametrize("dark", [0.5, -0.25])
@pytest.mark.parametrize("far", [0.0, 0.2, 0.35])
def test_a_glints_light_is_no_ink(dark: float, far: float) -> None:
    """Where ink is missing all around a glint nothing may pass as ink."""
    bare = (MIDDLE - 0.7, MIDDLE + 0.7)
    found = seen(dark, bare, (far, 0.16))
    at = found.stations
    inside = (at.stroke == 0) & (at.along_mm > bare[0] + 0.1) & (at.along_mm < bare[1] - 0.1)
    assert np.nanmax(np.where(at.seen, at.present, 0.0)[inside]) < 0.5


def test_what_a_glint_hides_beside_a_gap_is_gap_or_not_seen() -> None:
    """Of a clog half of which lay under a glint the other half alone was mended, silently."""
    found = seen(0.5, (MIDDLE - 0.2, MIDDLE + 1.0), (0.0, 0.16))
    (gap,) = found.gaps
    assert gap.to_mm == pytest.approx(MIDDLE + 1.0, abs=0.1)
    at = found.stations
    inside = (at.stroke == 0) & (at.along_mm > MIDDLE - 0.2) & (at.along_mm < gap.from_mm)
    assert not at.seen[inside].any()


# Vessels of one look that the view shows over each other.


LENGTH = 8.0
WIDE = 0.6
CROSSED_DARK = 0.8
"""Logarithm in a filament's middle."""


class Aslant:
    """A far camera that looks from above, or leans along y; higher places then lie further up."""

    def __init__(self, tilt: float = 0.0) -> None:
        self.tilt = tilt

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Pixels of places."""
        x, y, z = np.asarray(points_mm).T
        return np.column_stack([x, y * np.cos(self.tilt) + z * np.sin(self.tilt)]) / COARSE_MM


def _crossed(
    angle_deg: float,
    bare: dict[int, tuple[float, float]],
    dark: float = CROSSED_DARK,
    tilt: float = 0.0,
    aside: float = 0.0,
    heights: tuple[float, float] = (-2.5, -1.2),
) -> LayerFindings:
    """Findings of a lower filament, an upper one that crosses its middle, and two alone."""
    turn = np.deg2rad(angle_deg)
    ahead = np.array([[1, 0], [np.cos(turn), np.sin(turn)], [1, 0], [1, 0]])
    middle = np.array([[5, 5], [5, 5 + aside], [5, 2], [5, 8.0]])
    height = np.array([[*heights, -1.2, -2.5]]).T
    start, end = (np.hstack([middle + by * LENGTH * ahead, height]) for by in (-0.5, 0.5))
    frame, rng = Aslant(tilt), np.random.default_rng(4)
    y, x = np.mgrid[0:400, 0:400]
    logs = np.log(150.0) + 0.01 * cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 2.0)
    pairs = zip(frame.to_pixels(start), frame.to_pixels(end), strict=True)
    for number, (begin, stop) in enumerate(pairs):
        size = float(np.linalg.norm(stop - begin))
        way = (stop - begin) / size
        along = (x - begin[0]) * way[0] + (y - begin[1]) * way[1]
        across = ((x - begin[0]) * way[1] - (y - begin[1]) * way[0]) * COARSE_MM
        low, high = (size / LENGTH * at for at in bare.get(number, (99.0, 99.0)))
        own = (along > 0) & (along < size) & ~((along > low) & (along < high))
        logs -= dark * own * np.sqrt(np.clip(1.0 - (2.0 * across / WIDE) ** 2, 0.0, 1.0))
    light = cv2.GaussianBlur(np.exp(logs), (0, 0), 1.0) + rng.normal(0, 0.7, logs.shape)
    picture = np.clip(light, 0, 255).astype(np.uint8)
    return see_layer(picture, frame, lines_of(start, end, WIDE))


def _seen(found: LayerFindings, stroke: int, low: float, high: float) -> float:
    """Share of the stations there that are seen."""
    at = found.stations
    return float(at.seen[(at.stroke == stroke) & (at.along_mm > low) & (at.along_mm < high)].mean())


@pytest.mark.parametrize(("angle_deg", "gap_mm"), [(0, 3), (0, 8), (8, 3), (15, 2), (30, 1)])
def test_what_an_upper_filament_of_the_look_hides_is_not_seen(angle_deg, gap_mm):
    """It was marked as seen, with all of its ink."""
    low, high = (LENGTH - gap_mm) / 2, (LENGTH + gap_mm) / 2
    found = _crossed(angle_deg, {0: (low, high)})
    assert _seen(found, 0, low, high) == 0.0
    assert found.gaps == ()


def test_what_is_hidden_hangs_on_where_the_camera_stands() -> None:
    """Aslant by 30 degrees, the upper one shows 0.75 mm further aside than from above."""
    by = 1.3 * np.tan(np.deg2rad(30.0))
    hidden = _crossed(0, {0: (2.5, 5.5)}, tilt=np.deg2rad(30.0), aside=-by)
    assert _seen(hidden, 0, 2.5, 5.5) == 0.0
    open_to_it = _crossed(0, {0: (2.5, 5.5)}, tilt=np.deg2rad(30.0))
    assert [gap.stroke for gap in open_to_it.gaps] == [0]


@pytest.mark.parametrize("angle_deg", [0, 10])
def test_a_sound_lower_filament_has_no_gap_where_the_upper_one_has(angle_deg: float) -> None:
    """3.6 mm of it were to be written again."""
    found = _crossed(angle_deg, {1: (2.5, 5.5)}, dark=0.3)
    assert all(gap.stroke == 1 for gap in found.gaps)
    assert _unseen_mm(found, 1, 2.5, 5.5) > 2 or any(gap.stroke == 1 for gap in found.gaps)


def test_nothing_is_seen_where_filaments_cross_in_the_view() -> None:
    for bare in ({}, {0: (3.0, 5.0)}):
        found = _crossed(15, bare, dark=0.3)
        assert found.gaps == ()
        assert _seen(found, 0, 3.2, 4.8) == 0.0
