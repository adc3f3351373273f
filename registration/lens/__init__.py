"""Calibrate a camera with a ChArUco board: scale, distortion, undistorted pictures."""

from registration.lens.board import Board, BoardView, board_picture, find_board
from registration.lens.fit import fit_lens
from registration.lens.lens import Lens, read_lens, write_lens

__all__ = [
    "Board",
    "BoardView",
    "Lens",
    "board_picture",
    "find_board",
    "fit_lens",
    "read_lens",
    "write_lens",
]
