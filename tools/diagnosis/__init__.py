"""Given measured data: what the simulation gets wrong, which named cause explains it, what it gains.

The engine knows models, causes and runs, and no fish; ``fish/`` is one user of it.
"""
