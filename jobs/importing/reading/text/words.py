"""Words in text: names, references to other files, and the mark that some writers put before all of it."""

from __future__ import annotations

_MARK = b"\xef\xbb\xbf"


def without_mark(text: bytes) -> bytes:
    """A text without the byte-order mark of UTF-8 at its start."""
    return text.removeprefix(_MARK)


def name_of(word: bytes) -> str:
    """A name, without blanks around it. Bytes that are not UTF-8 are written out, so different names stay different."""
    return word.strip().decode("utf-8", "backslashreplace")


def reference_of(word: bytes) -> str:
    """The name of a file, without blanks around it: bytes that are not UTF-8 stay what they are (see `os.fsdecode`)."""
    return word.strip().decode("utf-8", "surrogateescape")
