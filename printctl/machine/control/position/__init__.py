"""Identity of a board and where its head stands.

Goes in: replies. Comes out: firmware and position. Begin with `place.py`.
"""
