"""Calibrate a camera with a ChArUco board: scale, distortion, undistorted pictures.

Goes in: pictures of a board. Comes out: a lens file, and undistorted pictures. Begin with
`fit.py`.
"""

from registration.devices.lens.board import Board, BoardView, board_picture, find_board
from registration.devices.lens.fit import fit_lens
from registration.devices.lens.lens import Lens, read_lens, write_lens

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
