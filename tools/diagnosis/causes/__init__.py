"""What may be wrong and has a name: a row for each cause."""

from tools.diagnosis.causes.table import CAUSES

__all__ = ["CAUSES"]
