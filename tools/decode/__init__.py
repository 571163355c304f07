"""Recorded traffic in words: readers of files, decoders of protocols, and what is printed."""
