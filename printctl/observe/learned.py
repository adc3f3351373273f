"""Ink and scanner as learned from pictures, as each look's record keeps it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from printctl.observe.devices import DeviceError
from printctl.observe.records import LookRecord
from printctl.observe.scan_place import ScanSize
from registration.inspection import Appearance
from registration.inspection.values import LineShapes

STATE = "learned"
"""Its key in `LookRecord.control`."""


@dataclass(frozen=True)
class Learned:
    """What the next look goes on from.

    Attributes
    ----------
    appearance : Appearance or None
        Of the ink.
    voxel_mm : tuple of float, mm
        Of the last scan in which lines were seen; empty for none.
    size : str
        How large that was and where it lay, in words.
    """

    appearance: Appearance | None = None
    voxel_mm: tuple[float, ...] = ()
    size: str = ""

    def state(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        look = self.appearance
        shapes = None if look is None or look.shapes is None else vars(look.shapes)
        return {
            "appearance": None if look is None else look.profile.tolist(),
            "shapes": shapes and {key: np.asarray(one).tolist() for key, one in shapes.items()},
            "voxel_mm": list(self.voxel_mm),
            "size": self.size,
        }

    @staticmethod
    def of_state(state: dict[str, Any]) -> Learned:
        """Return it from `state`."""
        told, shapes, look = state["appearance"], state.get("shapes"), None
        if isinstance(told, list):  # an older state has no profile
            known = shapes and LineShapes(
                np.array(shapes["misfits"]), np.array(shapes["log_ratio"]), int(shapes["looks"])
            )
            look = Appearance(np.array(told), known or None)
        return Learned(look, tuple(state["voxel_mm"]), state["size"])

    def size_words(self, size: ScanSize) -> str:
        """Where a scan that tells little lies.

        Raises
        ------
        DeviceError
            Where the last one had another spacing.
        """
        if self.size and self.voxel_mm != size.voxel_mm:
            raise DeviceError(
                f"nothing fits the lines in this scan: it has {size.words}; the last one that did "
                f"had {self.size}; set the scanner as before, or correct the voxel size (in the "
                "file or beside it), then resume"
            )
        wrong = "where that isn't so, correct the voxel size or observe.frame"
        return f"the scan has {size.words}: {wrong}"

    def with_size(self, size: ScanSize) -> Learned:
        """Return it with the size of a scan in which lines were seen."""
        return replace(self, voxel_mm=size.voxel_mm, size=size.words)

    @staticmethod
    def before(looks: Sequence[LookRecord], number: int) -> Learned:
        """Return what the last of the looks before one had learned."""
        known = [one for one in looks if one.number < number and STATE in one.control]
        return Learned.of_state(known[-1].control[STATE]) if known else Learned()
