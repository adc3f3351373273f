"""Error raised for a missing profile, an unknown key or an impossible value."""

from __future__ import annotations


class ProfileError(ValueError):
    """A profile that is missing, has an unknown key or an impossible value."""
