"""Property tests repeat themselves exactly and never look at the wall clock."""

from hypothesis import settings

settings.register_profile("fishbed", deadline=None, derandomize=True)
settings.load_profile("fishbed")
