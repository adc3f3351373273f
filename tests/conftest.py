"""Settings for all tests."""

import os

from hypothesis import settings

# No test asserts a wall-clock time; CI tries the same examples each time, a developer new ones.
settings.register_profile("printctl", deadline=None, derandomize="CI" in os.environ)
settings.load_profile("printctl")
