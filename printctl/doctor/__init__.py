"""`printctl doctor`'s checks of this computer."""

from printctl.doctor.collect import Examination, examine

__all__ = ["Examination", "examine"]
