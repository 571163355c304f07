"""The report: one self-contained page that shows a run, and its pictures."""
