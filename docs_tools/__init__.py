"""Makers of the user guide's pages: not part of the product."""
