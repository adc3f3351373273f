"""Draw a ChArUco board, and find its corners in a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.errors import PictureError

_LEAST_PX: Final = 100


def decoded(path: Path) -> NDArray[Any]:
    """Read a picture (PNG, TIFF, JPEG, BMP; 8 or 16 bits), (h, w, 3): blue, green, red.

    Raises
    ------
    PictureError
        When it can't be read, or is tiny.
    """
    try:
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except OSError as exc:
        raise PictureError(f"{path} can't be read: {exc.strerror}; check the path") from exc
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    image = cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH) if len(data) else None
    if image is None:
        raise PictureError(f"{path} isn't a picture that OpenCV reads; give PNG, TIFF or JPEG")
    if min(image.shape[:2]) < _LEAST_PX:
        raise PictureError(
            f"{path}: {image.shape[1]} x {image.shape[0]} px is too small to measure in; take a "
            "picture with more pixels"
        )
    return np.asarray(image)


FEWEST: Final = 12
"""Corners of a board that must be seen in a picture."""
_MOST_SQUARES: Final = 100
_LEAST_MM: Final = 0.01


@dataclass(frozen=True)
class Board:
    """A board.

    Attributes
    ----------
    columns, rows : int
        Squares.
    square_mm, marker_mm : float, mm
        Sides of the squares and of the markers in them.
    dictionary : str
        OpenCV's name of the markers' set, such as ``5X5_100``.

    Raises
    ------
    PictureError
        When there can't be such a board.
    """

    columns: int
    rows: int
    square_mm: float
    marker_mm: float
    dictionary: str = "5X5_100"

    def __post_init__(self) -> None:
        if not (min(self.columns, self.rows) >= 3 and max(self.columns, self.rows) < _MOST_SQUARES):
            raise PictureError(
                f"a board of {self.columns} by {self.rows} squares can't be; take 3 to "
                f"{_MOST_SQUARES - 1} a side"
            )
        if not _LEAST_MM < self.marker_mm < self.square_mm < np.inf:
            raise PictureError(
                f"markers of {self.marker_mm:g} mm don't fit into squares of {self.square_mm:g} "
                f"mm; measure both (above {_LEAST_MM:g} mm, the marker smaller)"
            )
        held, wanted = len(self._markers().bytesList), self.columns * self.rows // 2
        if wanted > held:
            raise PictureError(
                f"{self.columns} by {self.rows} squares hold {wanted} markers, and "
                f"{self.dictionary} has {held}; take a larger set, such as 5X5_1000"
            )

    def charuco(self, legacy: bool = False) -> Any:
        """OpenCV's board; ``legacy`` for the pattern of its versions before 4.6."""
        size = (self.columns, self.rows)
        board = cv2.aruco.CharucoBoard(size, self.square_mm, self.marker_mm, self._markers())
        board.setLegacyPattern(legacy)
        return board

    def _markers(self) -> Any:
        number = getattr(cv2.aruco, f"DICT_{self.dictionary.upper()}", None)
        if number is None:
            raise PictureError(
                f"there is no set of markers {self.dictionary!r}; take one of OpenCV's, such as "
                "4X4_50, 5X5_100, 6X6_250 (what the board's maker says)"
            )
        return cv2.aruco.getPredefinedDictionary(number)


@dataclass(frozen=True, eq=False)
class BoardView:
    """A board as a picture shows it.

    Attributes
    ----------
    places_mm : (n, 2) float64, mm
        Corners between squares, on the board.
    pixels : (n, 2) float64
        There; (0, 0) is the first pixel's middle.
    size_px : (width, height)
        Of the picture.
    """

    places_mm: FloatArray
    pixels: FloatArray
    size_px: tuple[int, int]


def board_picture(board: Board, dots_per_inch: float) -> NDArray[np.uint8]:
    """Picture of a board to be printed, a square of white around it, (h, w)."""
    side = round(board.square_mm * dots_per_inch / 25.4)
    size = (side * (board.columns + 2), side * (board.rows + 2))
    return np.asarray(board.charuco().generateImage(size, marginSize=side))


def find_board(path: Path, board: Board) -> BoardView:
    """Find a board in a picture; it need not be all in view.

    Raises
    ------
    PictureError
        When the picture can't be read, or shows too few of the board's corners.
    """
    image = decoded(path)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    eight = cv2.normalize(grey, np.empty(0), 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    corners, numbers = max((_corners(eight, board, way) for way in (False, True)), key=_count)
    if len(numbers) < FEWEST:
        raise PictureError(
            f"{path}: {len(numbers)} corners of the board are found ({FEWEST} wanted). Have the "
            "board flat, sharp and evenly lit, squares of 20 pixels or more; are squares, sizes "
            f"and markers ({board.dictionary}) those of this board?"
        )
    places = np.array(board.charuco().getChessboardCorners(), dtype=np.float64)
    return BoardView(places[numbers, :2], corners, (grey.shape[1], grey.shape[0]))


def _corners(grey: NDArray[np.uint8], board: Board, legacy: bool) -> tuple[FloatArray, Any]:
    """Pixels (n, 2) and numbers (n,) of the corners that are seen."""
    corners, numbers, *_ = cv2.aruco.CharucoDetector(board.charuco(legacy)).detectBoard(grey)
    if numbers is None or not len(numbers):
        return np.empty((0, 2)), np.empty(0, np.int64)
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2), np.asarray(numbers).ravel()


def _count(views: tuple[FloatArray, Any]) -> int:
    return len(views[1])
