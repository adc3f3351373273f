"""Check this computer for `printctl doctor`: installation, folders, serial ports; with remedies.

Goes in: this computer. Comes out: findings, each with its remedy. Begin with `collect.py`.
"""

from printctl.cli.doctor_checks.collect import Examination, examine

__all__ = ["Examination", "examine"]
