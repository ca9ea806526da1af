"""Fusion alone: of true masks spoilt on purpose, and how far views repeat each other."""
