"""Wrong arguments of inspection's public functions: each is refused by name, before any work."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from printctl.inspection import (
    Appearance,
    ExpectedLines,
    Lumen,
    SeeingOptions,
    Unseen,
    annotated,
    height_map,
    see_layer,
    surface_of,
)
from registration.errors import PictureError
from registration.files.readers.heights import HeightMap
from tests.printctl.inspection.painted import (
    Flat,
    from_above,
    lines_of,
    scan_of,
)

RNG = np.random.default_rng(0)
SIZE, COUNT = (200, 200), 5
PICTURE = RNG.normal(120.0, 4.0, (*SIZE, 3)).astype(np.uint8)
NOISE = RNG.integers(0, 256, PICTURE.shape).astype(np.uint8)
ENDS = np.column_stack([np.full(COUNT, 0.5), 0.5 + 0.7 * np.arange(COUNT), np.zeros(COUNT)])
FRAME, LINES = Flat(0.02), lines_of(ENDS, ENDS + (3.0, 0, 0), 0.3)
PLACES = LINES.start[:4]


class Other(Flat):
    """A frame that returns something else."""

    def __init__(self, pixels: Callable[[np.ndarray], Any]) -> None:
        self.to_pixels = pixels  # type: ignore[method-assign]


def _with(**change: Any) -> dict[str, ExpectedLines]:
    return {"lines": replace(LINES, **change)}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"picture": None}, "the picture is a value of type NoneType; expected"),
        ({"picture": PICTURE.tolist()}, "the picture is a value of type list"),
        ({"picture": PICTURE[:, :, :0]}, "the picture is an array of uint8, shape"),
        ({"picture": np.full(SIZE, np.nan)}, "no finite value"),
        ({"before": "a.png"}, "the picture before is a value of type str"),
        ({"before": PICTURE.astype(np.uint16) * 257}, "before is an array of uint16.*same camera"),
        ({"before": PICTURE / 255.0}, "before is an array of float64"),
        ({"before": np.zeros_like(PICTURE)}, "black, noise"),
        ({"before": NOISE}, "black, noise"),
        ({"picture": np.zeros_like(PICTURE), "before": PICTURE}, "black, noise"),
        ({"picture": PICTURE / 1.0, "before": PICTURE / 255.0}, "black, noise"),
        ({"frame": np.eye(4)}, "frame is an array.*to_pixels"),
        ({"frame": Other(lambda at: at)}, r"to_pixels returns.*\(\d+, 2\)"),
        ({"frame": Other(lambda at: np.where(at < 1, np.nan, at)[:, :2])}, "pixel for 6 of 10"),
        ({"lines": [1]}, "lines is a value of type list; expected ExpectedLines"),
        (_with(stroke=LINES.stroke * 1.0), "stroke is an array of float64.*whole numbers"),
        (_with(start=LINES.start.tolist()), "start is a value of type list"),
        (_with(width_mm=LINES.width_mm[:, None]), "width_mm is an array"),
        (_with(fresh=LINES.fresh.astype(int)), "fresh is an array of int64.*bool"),
        ({"hidden": np.zeros((5, 5), bool)}, "hidden is an array of bool, shape"),
        ({"hidden": np.zeros(SIZE)}, "hidden is an array of float64"),
        ({"hidden": None}, "hidden is a value of type NoneType; expected a list"),
        ({"hidden": [np.zeros((3, 3))]}, "polygon 0 is an array"),
        ({"hidden": [np.full((3, 2), np.nan)]}, "polygon 0 holds NaN"),
        ({"since": np.zeros(COUNT + 1, bool)}, "since is an array of bool, shape"),
        ({"since": [True] * COUNT}, "since is a value of type list"),
        ({"lumens": None}, "lumens is a value of type NoneType"),
        ({"lumens": ["a"]}, "lumens holds a value of type str"),
        ({"lumens": [Lumen("a", PLACES * np.nan, 0.3)]}, "lumen a: outline holds NaN"),
        ({"lumens": [Lumen("a", PLACES, 0.0)]}, "lumen a: width_mm is 0 mm"),
        ({"known": "x"}, "known is a value of type str"),
        ({"known": Appearance(np.full((3, 5, 16, 3), np.nan))}, "known: profile holds NaN"),
        ({"thickness_mm": "a"}, "thickness_mm is a value of type str"),
        ({"thickness_mm": 0.0}, "thickness_mm is 0 mm; it must lie from"),
        ({"thickness_mm": 0.3}, "no height map"),
        ({"options": {"gap_mm": 1}}, "options is a value of type dict"),
    ],
)
def test_what_a_look_cannot_use_is_refused_by_name(given: dict[str, Any], words: str) -> None:
    with pytest.raises(PictureError, match=words):
        see_layer(**{"picture": PICTURE, "frame": FRAME, "lines": LINES, **given})


@pytest.mark.parametrize("picture", [np.zeros_like(PICTURE), np.full_like(PICTURE, 255), NOISE])
def test_of_a_picture_that_shows_nothing_nothing_is_seen(picture: np.ndarray) -> None:
    found = see_layer(picture, FRAME, LINES)
    assert found.seen_share == 0.0
    assert not found.gaps
    assert set(found.stations.why) <= {Unseen.FAINT, Unseen.HIDDEN, Unseen.COVERED}


@pytest.mark.parametrize(
    "given",
    [
        *({"gap_mm": value} for value in (0.0, -1.0, np.nan, np.inf, "0.2", None)),
        *({"width_percent": value} for value in (0.0, 101.0, True)),
        *({"shift_mm": value} for value in (0.0, 1e6)),
        *({"false_rate": value} for value in (0.0, 1.0)),
    ],
)
def test_options_out_of_their_limits_are_refused(given: dict[str, Any]) -> None:
    with pytest.raises(PictureError, match=next(iter(given))):
        SeeingOptions(**given)


HEIGHTS = HeightMap(np.zeros((40, 40), np.float32), (0.1, 0.1))
SCAN = scan_of(NOISE[:40, :40, :] + 1.0, (0.03, 0.03, 0.03))
UP, DOWN = np.eye(4), from_above(1.0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: surface_of(HEIGHTS.height_mm, UP, 0.3, 0.3, LINES), "expected HeightMap"),  # type: ignore[arg-type]
        (lambda: surface_of(HEIGHTS, np.eye(3), 0.3, 0.3, LINES), r"shape \(4, 4\)"),
        (lambda: surface_of(HEIGHTS, UP, np.nan, 0.3, LINES), "middle_z_mm is nan mm"),
        (lambda: surface_of(HEIGHTS, UP, 0.3, 0.0, LINES), "thickness_mm is 0 mm"),
        (lambda: surface_of(HEIGHTS, UP, 0.3, 0.3, None), "expected ExpectedLines"),  # type: ignore[arg-type]
        (
            lambda: surface_of(replace(HEIGHTS, pixel_mm=(0.0, 0.1)), UP, 0.3, 0.3, LINES),
            "pixel_mm is 0 mm",
        ),
        (lambda: height_map(SCAN.volume, DOWN, 0.3, 0.3), "expected Scan"),  # type: ignore[arg-type]
        (lambda: height_map(SCAN, DOWN * np.nan, 0.3, 0.3), "holds NaN"),
        (lambda: height_map(SCAN, np.diag([0.0, 1, -1, 1]), 0.3, 0.3), "can't be inverted"),
        (lambda: height_map(SCAN, DOWN, 0.3, -1.0), "thickness_mm is -1 mm"),
        (lambda: annotated(PICTURE, FRAME, None), "findings is a value"),  # type: ignore[arg-type]
    ],
)
def test_maps_and_drawings_refuse_what_they_cannot_use(
    call: Callable[[], object], words: str
) -> None:
    with pytest.raises(PictureError, match=words):
        call()
