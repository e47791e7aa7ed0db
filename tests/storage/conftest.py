"""Settings of the tests of storage."""

from hypothesis import settings

# The first call of a kernel compiles it, so no example may be timed.
settings.register_profile("storage", deadline=None)
settings.load_profile("storage")
