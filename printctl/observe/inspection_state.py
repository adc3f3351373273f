"""State that an inspection keeps from layer to layer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from printctl.inspection import Appearance
from printctl.inspection.values import LineShapes
from printctl.observe.devices import DeviceError
from printctl.observe.looks.height_maps import ScanSize


@dataclass(frozen=True)
class InspectionState:
    """Ink appearance and scan size that a look hands to the next; saved in its record.

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
        """Return the state ready for JSON."""
        look = self.appearance
        shapes = None if look is None or look.shapes is None else vars(look.shapes)
        return {
            "appearance": None if look is None else look.profile.tolist(),
            "shapes": shapes and {key: np.asarray(one).tolist() for key, one in shapes.items()},
            "voxel_mm": list(self.voxel_mm),
            "size": self.size,
        }

    @staticmethod
    def from_state(state: dict[str, Any] | None) -> InspectionState:
        """Return the state of `state`; an empty one from None."""
        if state is None:
            return InspectionState()
        profile, shapes, look = state["appearance"], state.get("shapes"), None
        if isinstance(profile, list):  # an older state has none
            known = shapes and LineShapes(
                np.array(shapes["misfits"]), np.array(shapes["log_ratio"]), int(shapes["looks"])
            )
            look = Appearance(np.array(profile), known or None)
        return InspectionState(look, tuple(state["voxel_mm"]), state["size"])

    def size_words(self, size: ScanSize) -> str:
        """Return in words the size and place of a scan in which little is seen.

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
