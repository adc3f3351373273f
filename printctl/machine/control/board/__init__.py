"""Talk with one board: sending, replies, heat, halts, the log.

Goes in: lines. Comes out: replies. Begin with `channel.py`.
"""
