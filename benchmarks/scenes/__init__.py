"""Whole runs on simulated scenes, against the truth."""
