"""Applications of the processing board (head level of the source's section 2.3)."""
