"""Given measured data: what the simulation gets wrong, which cause explains it, what that gains.

The engine knows models, causes and runs, and no fish; ``fish/`` is one user of it.
"""
