"""Registrations found in folders, ready to be compared."""

from printctl.comparing.identity import print_identity
from printctl.comparing.read import Judged, read_folders

__all__ = ["Judged", "print_identity", "read_folders"]
