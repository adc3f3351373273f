"""Networks as users name them: files of every format, run folders, and what is known of them."""

from printctl.networks.formats import LOSSES, check_target, read_network, write_network
from printctl.networks.source import Drive, Source, load_source, read_surface

__all__ = [
    "LOSSES",
    "Drive",
    "Source",
    "check_target",
    "load_source",
    "read_network",
    "read_surface",
    "write_network",
]
