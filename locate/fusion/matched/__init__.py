"""Plumes that no single pixel shows: the turn of the displacement across an axis, added up."""
