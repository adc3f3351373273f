"""Read and write networks in every supported format; load them from run folders with flow.

Goes in: a path. Comes out: a network with its known flow and tissue. Begin with `source.py`.
"""

from design.network_files.by_suffix import READ
from printctl.analysis.networks.formats import LOSSES, check_target, read_noted, write_network
from printctl.analysis.networks.source import Drive, Source, load_source

__all__ = [
    "LOSSES",
    "READ",
    "Drive",
    "Source",
    "check_target",
    "load_source",
    "read_noted",
    "write_network",
]
