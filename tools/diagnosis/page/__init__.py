"""report.html of a diagnosis: a sentence first, then its evidence, in words and pictures."""
