"""Reader of Aerotech controllers' program files, for dry runs of jobs that aren't G-code.

Goes in: a program file. Comes out: the same in G-code words. Begin with `reading.py`.
"""
