"""Translate Aerotech controllers' program files to G-code words.

Goes in: a program file. Comes out: the same in G-code words. Begin with `reading.py`.
"""
