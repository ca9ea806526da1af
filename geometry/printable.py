"""Texts with parts of file names that are not UTF-8."""

import re

UNDECODED = re.compile("[\ud800-\udfff]")
"""What Python puts for a byte of a file name that it cannot decode (PEP 383)."""


def printable(text: str) -> str:
    r"""A text that can be printed and stored: a byte of a name that is no UTF-8 as ``\xe9``."""
    return UNDECODED.sub(lambda found: f"\\x{ord(found[0]) & 0xFF:02x}", text)
