"""`printctl doctor`'s checks of this computer.

Goes in: this computer. Comes out: findings, each with its remedy. Begin with `collect.py`.
"""

from printctl.doctor.collect import Examination, examine

__all__ = ["Examination", "examine"]
