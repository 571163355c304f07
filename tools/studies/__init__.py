"""Studies: every published figure and table of the source, computed again."""

from tools.studies.table import STUDIES

__all__ = ["STUDIES"]
