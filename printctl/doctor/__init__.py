"""Checks of `printctl doctor`: this machine, and obstacles to printctl on it."""

from printctl.doctor.look import Examined, examine

__all__ = ["Examined", "examine"]
