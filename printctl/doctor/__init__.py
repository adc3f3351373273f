"""`printctl doctor`'s checks of this computer."""

from printctl.doctor.look import Examined, examine

__all__ = ["Examined", "examine"]
