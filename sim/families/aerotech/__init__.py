"""Reader of Aerotech controllers' program files.

Goes in: a program file. Comes out: the same in G-code words. Begin with `reading.py`.
"""
