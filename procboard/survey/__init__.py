"""What a survey decides: which cells are sampled next, by whom, and what the field is."""
