"""Write ordered pieces: travels above the print, joints overlapped."""

from __future__ import annotations

import numpy as np

from design.toolpath.embedded.filament import frustum_ul, writing_speed
from design.toolpath.embedded.heads import EmbeddedHeads
from design.toolpath.embedded.pieces import Piece
from design.toolpath.moves import MoveBuilder
from design.toolpath.toolpath import FloatArray


class FilamentWriter:
    """Turns pieces into moves, and counts joints and starts.

    Attributes
    ----------
    builder : MoveBuilder
        Where the moves go.
    passes, joints, overlapped, continued : int
    overlap_ul : float, µL
        As in `EmbeddedReport`.
    """

    def __init__(self, first: Piece, heads: EmbeddedHeads) -> None:
        self.builder = MoveBuilder(first.points[0], "vessel")
        self.passes = self.joints = self.overlapped = self.continued = 0
        self.overlap_ul = 0.0
        self._heads, self._head = heads, heads.of(first.vessel)
        self._options = heads.options[self._head]
        self.builder.tool = self._head
        self._pressed: set[int] = set()
        self._widest: dict[int, float] = {}
        self._top = -np.inf
        self._node = -1

    def write(self, piece: Piece) -> Piece:
        """Write one piece from its first point, going there as needed; returns it as written."""
        path, head = piece, self._heads.of(piece.vessel)
        goes_on = piece.ends[0] == self._node and head == self._head
        self.continued += goes_on
        self.joints += goes_on
        if not goes_on and self._is_joint(piece.ends[0]):
            path = self._overlapping(path.reversed(), piece.ends[0]).reversed()
        self._wrote(piece.ends[0], piece.radius[0])  # so that a ring's end meets its beginning
        if self._is_joint(piece.ends[1]):
            path = self._overlapping(path, piece.ends[1])
        if not goes_on:
            self._go(path.points[0], path.vessel, head)
        length = np.linalg.norm(np.diff(path.points, axis=0), axis=1)
        volume = frustum_ul(path.points, path.radius)
        speed = writing_speed(volume / length, self._options)
        self.builder.write(path.points[1:], volume, speed, path.vessel)
        self._pressed.add(head)
        self._wrote(piece.ends[1], piece.radius[-1])
        self._top = max(self._top, float((path.points[:, 2] + path.radius).max()))
        self._node = piece.ends[1]
        return path

    def _is_joint(self, node: int) -> bool:
        if node not in self._widest:
            return False
        self.joints += 1
        return True

    def _wrote(self, node: int, radius: float) -> None:
        self._widest[node] = max(self._widest.get(node, 0.0), float(radius))

    def _overlapping(self, piece: Piece, node: int) -> Piece:
        """Go on past the last point, into what is written there.

        By radii of the thinner of the two: a wide vessel that went on by its own would swell the
        thin one that it meets.
        """
        own = float(piece.radius[-1])
        radii = self._options.overlap_radii * min(1.0, self._widest[node] / own)
        longer = piece.extended(radii)
        if longer is not piece:
            self.overlapped += 1
            self.overlap_ul += float(np.pi * own**3 * radii)
        return longer

    def _go(self, to: FloatArray, vessel: int, head: int) -> None:
        """Retract, rise above everything written, cross, go down, prime.

        With another head from the way across on; one that has pushed nothing yet isn't primed.
        """
        options, builder = self._options, self.builder
        self.passes += 1
        if self.passes > 1:
            builder.plunge(-options.retract_ul, options.plunger_ul_s, vessel)
            tip = builder.tip
            top = max(self._top, tip[2], to[2]) + options.lift_mm
            up, across = np.array([*tip[:2], top]), np.array([*to[:2], top])
            builder.travel(up[None], options.lift_speed_mm_s, vessel)
            self._head = builder.tool = head
            options = self._options = self._heads.options[head]
            if np.any(across != up):
                builder.travel(across[None], options.travel_speed_mm_s, vessel)
            builder.travel(to[None], options.lift_speed_mm_s, vessel)
            if head in self._pressed:
                builder.plunge(options.retract_ul, options.plunger_ul_s, vessel)
        builder.dwell(options.dwell_s, vessel)
