"""Output files of `gaitd replay`: their names, the check against inputs, all-or-nothing writing."""

import os
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

ESTIMATES = ".estimates.csv"
PICTURE = ".png"
OPTIONS = {
    "--output": ESTIMATES,
    "--plot": PICTURE,
    "--strides": ".strides.csv",
    "--strides-plot": ".strides.png",
}
"""Option of each output file, in the order of `Targets`, and the end of its name in a folder."""


class FileError(Exception):
    """A file cannot be written at its place; the text names the option, the file and the reason."""


class Wanted(NamedTuple):
    """Output paths from the command line; each is a file, or a folder for several results."""

    output: Path | None
    plot: Path | None
    strides: Path | None
    strides_plot: Path | None = None


class Targets(NamedTuple):
    """Output files of one result."""

    output: Path
    plot: Path | None
    strides: Path | None
    strides_plot: Path | None = None


def targets_of(wanted: Wanted, results: Sequence[tuple[Path, str]], many: bool) -> list[Targets]:
    """Determine the output files of each result.

    A result is a recording, or one leg of a recording with several legs. A folder gets files named
    after the recording. In a file's name the leg is inserted before the suffix.

    Args:
        wanted: paths of the options.
        results: recording, and leg or an empty text.
        many: several recordings, for which an option can only be a folder.

    Raises:
        FileError: several recordings, and an option that is no folder.
    """
    for option, path in zip(OPTIONS, wanted, strict=True):
        if many and path is not None and not path.is_dir():
            raise FileError(f"{option} {path}: must be an existing folder for several recordings")
    output, *others = OPTIONS.values()
    return [
        Targets(
            _named(wanted.output, recorded, leg, output)
            if wanted.output
            else recorded.with_name(_name(recorded, leg, output)),
            *(
                path and _named(path, recorded, leg, suffix)
                for path, suffix in zip(wanted[1:], others, strict=True)
            ),
        )
        for recorded, leg in results
    ]


def _name(recorded: Path, leg: str, suffix: str) -> str:
    return recorded.name + (f".{leg}" if leg else "") + suffix


def _named(option: Path, recorded: Path, leg: str, suffix: str) -> Path:
    if option.is_dir():
        return option / _name(recorded, leg, suffix)
    return option.with_name(f"{option.stem}.{leg}{option.suffix}") if leg else option


def check(targets: Sequence[Targets], inputs: Sequence[Path]) -> None:
    """Check that all files can be written, that they differ, and that none is an input.

    Raises:
        FileError: the first violation.
    """
    taken: dict[Path, str] = {}
    for one in targets:
        for option, path in zip(OPTIONS, one, strict=True):
            if path is not None:
                _check_place(option, path, inputs)
                if path.resolve() in taken:
                    raise FileError(f"{option} {path}: is the file of {taken[path.resolve()]} too")
                taken[path.resolve()] = option


def _check_place(option: str, path: Path, inputs: Sequence[Path]) -> None:
    if option.endswith("plot") and path.suffix.lower() != PICTURE:
        raise FileError(f"{option} {path}: must end in {PICTURE}")
    if not path.parent.is_dir():
        raise FileError(f"{option} {path}: there is no folder {path.parent}")
    if path.is_dir():
        raise FileError(f"{option} {path}: is a folder")
    for given in inputs:
        if path.exists() and given.exists() and path.samefile(given):
            what = "the recording itself" if given == inputs[0] else "an input, too"
            raise FileError(f"{path}: is {what}; {option} must be another file")


@contextmanager
def appearing(path: Path) -> Generator[Path]:
    """Yield a file for writing that replaces `path` at the end, and is deleted after an error.

    A path that is no regular file (`/dev/null`, a pipe) is written directly.
    """
    path = path.resolve()
    if path.exists() and not path.is_file():
        yield path
        return
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
