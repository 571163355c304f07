"""What is measured by ``python -m tools.benchmark``: one file for each part of the project."""
