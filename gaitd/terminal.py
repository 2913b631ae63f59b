"""Shared by all commands: tables and progress bars on a terminal, plain text in a pipe."""

import math
import sys
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol, TypeVar

if TYPE_CHECKING:
    from drives.service.scan import Progress

T = TypeVar("T")

Table = tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]
"""Title, column heads, rows of text."""


def show(tables: Iterable[Table]) -> None:
    """Print tables on a terminal, aligned text in a pipe."""
    if sys.stdout.isatty():
        print_tables(tables)
    else:
        print("\n\n".join(map(plain, tables)))


def plain(table: Table) -> str:
    """Format a table as aligned text, for pipes and logs."""
    title, columns, rows = table
    lines = (columns, *rows) if any(columns) else rows
    widths = [max(len(line[i]) for line in lines) for i in range(len(columns))]
    texts = (
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )
    return "\n".join((title, *(f"  {text}" for text in texts)))


def print_tables(tables: Iterable[Table]) -> None:
    """Print tables as a terminal shows them."""
    from rich import box, console, markup, table

    out = console.Console()
    for title, columns, rows in tables:
        made = table.Table(
            title=title,
            title_justify="left",
            title_style="bold",
            box=box.SIMPLE_HEAD,
            show_header=any(columns),
        )
        for column in columns:
            made.add_column(column, overflow="fold")
        for row in rows:
            made.add_row(*map(markup.escape, row))
        out.print(made)


class Update(Protocol):
    """Moves a progress bar."""

    def __call__(self, done: float, /, text: str | None = None, total: float | None = None) -> None:
        """Show what is done, from 0 to the total, and a new text or total if given."""
        ...


@contextmanager
def progress(line_every: float | None = None) -> Generator[Callable[..., Update]]:
    """Progress bar on stderr on a terminal; elsewhere nothing, or lines of text.

    Args:
        line_every: what must be done between two lines; None for no lines.

    Yields: a function that begins a stage, `stage(title, total=1.0)`, and returns its `Update`.
    """
    from rich import progress as rich
    from rich.console import Console

    console = Console(stderr=True)
    columns = (rich.TextColumn("{task.description:<34}"), rich.BarColumn())
    with rich.Progress(
        *columns,
        rich.TaskProgressColumn(),
        rich.TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bars:

        def stage(title: str, total: float = 1.0) -> Update:
            for before in bars.task_ids:
                bars.update(before, visible=False)
            task = bars.add_task(title, total=total)
            printed = -math.inf

            def update(done: float, /, text: str | None = None, total: float | None = None) -> None:
                nonlocal printed
                bars.update(task, completed=done, description=text, total=total)
                if bars.disable and line_every is not None and done >= printed + line_every:
                    printed = done
                    print(f"{done:7.0f}  {text}", file=sys.stderr, flush=True)

            return update

        yield stage


def run_with_progress(steps: "Generator[Progress, None, T]") -> T:
    """Run a generator of progress under a progress bar and return its result."""
    with progress() as stage:
        update = stage("")
        while True:
            try:
                step = next(steps)
            except StopIteration as stop:
                return stop.value
            update(step.done_count, step.text, step.total_count)
