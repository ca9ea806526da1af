"""The answer in the formats of other programs, and as a page for people."""
