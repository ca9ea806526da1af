"""Texts that may hold parts of file names: bytes that are not UTF-8, control characters."""

import re

UNPRINTABLE = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")
"""Control characters, which terminals obey and XML forbids, separators of lines, and what Python
puts for a byte of a file name that it cannot decode (PEP 383)."""


def printable(text: str) -> str:
    r"""A text that can be printed and stored, on one line: ``\x1b`` for an escape character.

    A byte of a name that is not UTF-8 becomes ``\xe9``, too.
    """
    return UNPRINTABLE.sub(_escape, text)


def printable_lines(text: str) -> str:
    r"""The same of a text of several lines, which stay, as tabs do."""
    return "\n".join("\t".join(map(printable, line.split("\t"))) for line in text.split("\n"))


def _escape(found: re.Match[str]) -> str:
    code = ord(found[0])
    return f"\\u{code:04x}" if 0x100 <= code < 0xD800 else f"\\x{code & 0xFF:02x}"
