"""Chips of the processing board that no other package models."""
