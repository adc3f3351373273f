"""What `printctl doctor` looks at: this machine, and what keeps printctl from working on it."""

from printctl.doctor.look import Examined, examine

__all__ = ["Examined", "examine"]
