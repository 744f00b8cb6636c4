"""Settings of all tests: none is timed, and automatic runs draw the same examples every time."""

from __future__ import annotations

import os

from hypothesis import settings

settings.register_profile("etude", deadline=None, derandomize="CI" in os.environ, print_blob=True)
settings.load_profile("etude")
