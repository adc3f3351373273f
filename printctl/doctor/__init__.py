"""`printctl doctor`'s checks of this computer."""

from printctl.doctor.look import Examination, examine

__all__ = ["Examination", "examine"]
