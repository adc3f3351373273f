"""A G-code program as a table: words, modal state, findings, and the commands as written."""
