"""Read registrations of several prints from folders, for `printctl compare`.

Goes in: folders. Comes out: registrations as `registration.comparison` takes them. Begin with
`read.py`.
"""

from printctl.history.comparing.read import NewLimits, PrintNames, read_folders
from printctl.machine.link.print_identity import print_identity

__all__ = ["NewLimits", "PrintNames", "print_identity", "read_folders"]
