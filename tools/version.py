"""The version of this software, as installed; from the project file when run from a checkout."""

from __future__ import annotations

from functools import cache


@cache
def version() -> str:
    """Version string such as `0.1.0`."""
    from importlib.metadata import PackageNotFoundError
    from importlib.metadata import version as installed

    try:
        return installed("fishbed")
    except PackageNotFoundError:
        import tomllib
        from pathlib import Path

        project = Path(__file__).resolve().parent.parent / "pyproject.toml"
        return str(tomllib.loads(project.read_text(encoding="utf-8"))["project"]["version"])
