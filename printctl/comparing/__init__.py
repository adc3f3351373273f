"""Read registrations of several prints from folders, for `printctl compare`."""

from printctl.comparing.read import Judged, Named, read_folders
from printctl.link.print_identity import print_identity

__all__ = ["Judged", "Named", "print_identity", "read_folders"]
