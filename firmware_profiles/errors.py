"""Errors of the profiles."""

from __future__ import annotations


class ProfileError(ValueError):
    """A profile that is missing, has an unknown key or an impossible value."""
