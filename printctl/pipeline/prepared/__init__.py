"""Values that several stages share: solids, corrected layers, primes, lags.

Goes in: the run's context. Comes out: prepared values. Begin with `solid_build.py`.
"""
