"""Flights joined into a survey: accuracy, and what joining and flying cost."""
