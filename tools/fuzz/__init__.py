"""Coverage-guided fuzzing of every decoder (atheris): `python -m tools.fuzz TARGET`."""
