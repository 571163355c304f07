"""What a run leaves behind: run data, the run folder and its files."""
