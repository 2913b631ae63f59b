"""Markdown of the written pages: every program that writes a page makes its tables here."""

from collections.abc import Iterable, Mapping, Sequence


def page(*parts: str) -> str:
    """Join paragraphs, headings and tables to a page: a blank line between them."""
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def table(
    head: Sequence[str], rows: Iterable[Sequence[str]], text_columns: int | None = None
) -> str:
    """Return a table.

    Args:
        head: names of the columns.
        rows: texts of the cells, as many as there are columns.
        text_columns: the columns after so many hold numbers and are aligned right; None: no column.
    """
    left = len(head) if text_columns is None else text_columns
    rule = ["---"] * left + ["---:"] * (len(head) - left)
    return "\n".join(map(_line, (head, rule, *rows)))


def filled(text: str, parts: Mapping[str, str]) -> str:
    """Return a page with the text between the comments `NAME: begin` and `NAME: end` replaced.

    Args:
        text: the page.
        parts: new text of each name.

    Raises:
        ValueError: the page has no place for one of them.
    """
    for name, part in parts.items():
        begin, end = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->"
        before, found, rest = text.partition(begin)
        _, closed, after = rest.partition(end)
        if not (found and closed):
            raise ValueError(f"the page has no lines {begin!r} and {end!r}")
        text = f"{before}{begin}{part}\n{end}{after}"
    return text


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
