"""Serialise a print order (job file, set-up, start) as JSON for the station's socket."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # its package knows meshes, and a kill shouldn't wait for their libraries
    from printctl.machine.printing.find import Order


def order_to_json(order: Order) -> dict[str, Any]:
    """An order as a JSON object."""
    return {
        "job": str(order.job.resolve()),
        "printer": order.printer,
        "folder": str(order.folder.resolve()),
        "retreat": asdict(order.retreat),
        "care": order.care.to_dict(),
    }
