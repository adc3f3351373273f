"""Read, time and dry-run G-code, and predict what it deposits.

Goes in: G-code. Comes out: executed motion, time, findings, deposited ink. Begin with
`dry_run/run.py`.
"""
