"""Text of a client or a drive, made safe for one line of output."""


def printable(text: str) -> str:
    """The text with line breaks and control characters as escapes, for one line of output."""
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in text)
