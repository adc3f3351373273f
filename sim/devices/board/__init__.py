"""Simulated controller board: parts shared by all simulated firmware families.

Goes in: bytes of a host. Comes out: replies and motion, in virtual time. Begin with
`controller.py`.
"""
