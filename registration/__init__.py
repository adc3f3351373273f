"""Scan to report: read, segment, align, gauge.

`import registration` gives what scripts and notebooks use: the names of
`registration.interface`, which
docs/python.md shows. Each is loaded when it is first asked for: a command that needs one room
shouldn't wait for all.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from registration.interface import *

__all__ = [
    "RegistrationError",
    "RegistrationOptions",
    "RegistrationReport",
    "Scan",
    "ScanOverrides",
    "read_scan",
    "register_scan",
    "report_dict",
    "vessel_rows",
    "write_report",
    "write_scan_tiff",
    "write_tables",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("registration.interface"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
