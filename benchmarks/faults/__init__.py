"""Faults while `locate run` is at work on its folder, and whether anything is lost by them."""
