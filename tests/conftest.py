"""Settings of all tests: hypothesis draws the same examples every time."""

from hypothesis import settings

settings.register_profile("reproducible", derandomize=True, deadline=None)
settings.load_profile("reproducible")
