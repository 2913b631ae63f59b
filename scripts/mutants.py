"""Mutation testing of files behind the safety gates (`safety_gates.py`): `make mutants`.

Each mutant is one small change to one file, made in memory and never on disk. A fresh process
imports it in place of the module and runs the unit tests of that file, one of which must fail.
`docs/mutants.md` must give a reason for each survivor, row by row. A survivor without a row, and a
row without a survivor, end the run with exit code 1.

The mutations are those of Cosmic Ray and of `mutation_operators.py`. Cosmic Ray's own runner starts
Python and imports everything anew for each mutant, and writes into the work tree. Here each process
is forked from one that has imported what the tests need, except the mutated module.
"""

import argparse
import ast
import contextlib
import difflib
import gc
import importlib
import importlib.abc
import importlib.util
import json
import multiprocessing
import os
import re
import sys
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from enum import Enum
from pathlib import Path
from typing import NamedTuple

PROJECT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(PROJECT), str(PROJECT / "scripts")]
sys.dont_write_bytecode = False
sys.pycache_prefix = str(PROJECT / ".venv" / "pycache")  # otherwise each process compiles the tests
SURVIVORS = PROJECT / ".venv" / "mutants.json"
"""Survivors of the last run. `--again` tests only these, while the mutated files stay the same."""
EQUIVALENTS = PROJECT / "docs" / "mutants.md"

import hypothesis  # noqa: E402 - after the path
import mutation_operators  # noqa: E402
import pytest  # noqa: E402
from cosmic_ray.ast import ast_nodes, get_ast  # noqa: E402
from cosmic_ray.mutating import MutationVisitor  # noqa: E402
from cosmic_ray.operators.operator import Operator  # noqa: E402
from cosmic_ray.operators.provider import OperatorProvider  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.progress import Progress  # noqa: E402
from rich.table import Table  # noqa: E402
from safety_gates import MUTATED, UNIT_TESTS, without_compiled_kernels  # noqa: E402

without_compiled_kernels()

SOURCES = {file: (PROJECT / file).read_text(encoding="utf-8") for file in UNIT_TESTS}
TREES = {file: get_ast(source) for file, source in SOURCES.items()}
"""Parsed once; each process changes its own copy after the fork."""

LEFT_OUT = re.compile(
    "|".join(
        [
            "VariableReplacer",  # need arguments
            "VariableInserter",
            # Equivalent for members of an enum, None and True.
            "ReplaceComparisonOperator_(Is_Eq|Eq_Is|IsNot_NotEq|NotEq_IsNot)$",
        ]
    )
)
"""Operators of Cosmic Ray that are not used."""

PRELOADED = (
    *("hypothesis.stateful", "_hypothesis_pytestplugin", "pytest_timeout", "numpy"),
    *("numba", "canopen", "msgspec", "zenoh", "daemon.ipc.record"),
)
"""Slow imports of the tests, without any module that imports a mutated one."""

TEST_TIMEOUT_S = 60
"""Limit for one test of a mutant that loops for ever; without one a test takes below a second."""


class Outcome(Enum):
    """Result of a mutant."""

    KILLED = "killed"
    SURVIVED = "survived"
    SAME = "same"
    """The change touches an annotation, a docstring or nothing: Python runs the same code."""


class Spec(NamedTuple):
    """One mutation: the file, the operator, and the number of its occurrence."""

    file: str
    operator: str
    occurrence: int


class Key(NamedTuple):
    """Identification of a mutant in docs/mutants.md."""

    file: str
    function: str
    before: str
    after: str


class Judged(NamedTuple):
    """A mutant and its result."""

    spec: Spec
    outcome: Outcome
    key: Key


def module_name(file: str) -> str:
    """Module name of a path: `daemon.core.modes.table` for `daemon/core/modes/table.py`."""
    return file.removesuffix(".py").replace("/", ".")


def operator(name: str, file: str) -> Operator:
    """Create an operator by its name; those of this project read the module to be changed."""
    ours = getattr(mutation_operators, name, None)
    if ours is None:
        return OperatorProvider()[name]()
    spec = importlib.util.spec_from_file_location("unmutated", PROJECT / file)
    if spec is None or spec.loader is None:
        raise RuntimeError(f"{file} cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules["unmutated"] = module  # dataclasses look their module up here
    spec.loader.exec_module(module)
    return ours(vars(module), SOURCES[file])


def specs_of(file: str, functions: Collection[str]) -> Iterator[Spec]:
    """Every mutation of a file by any operator, or only those in the given functions."""
    nodes = list(ast_nodes(TREES[file]))
    ours = [one.__name__ for one in mutation_operators.OPERATORS]
    for name in [*(n for n in OperatorProvider() if not LEFT_OUT.search(n)), *ours]:
        one = operator(name, file)
        places = [place for node in nodes for place in one.mutation_positions(node)]
        for number, ((line, _), _) in enumerate(places):
            if not functions or _enclosing(SOURCES[file], line) in functions:
                yield Spec(file, name, number)


class _Bare(ast.NodeTransformer):
    """Reduces source to the code that Python runs: without annotations and docstrings."""

    def visit_arg(self, node: ast.arg) -> ast.AST:
        node.annotation = None
        return node

    def visit_arguments(self, node: ast.arguments) -> ast.AST:
        """Merge all kinds of arguments: Cosmic Ray mutates the bare star like a multiplication."""
        node.args = [*node.posonlyargs, *node.args, *node.kwonlyargs]
        node.defaults = [*node.defaults, *(one for one in node.kw_defaults if one is not None)]
        node.posonlyargs, node.kwonlyargs, node.kw_defaults = [], [], []
        return self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        return self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.annotation = ast.Constant(None)
        return self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        alone = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return ast.Pass() if alone else self.generic_visit(node)


def what_runs(source: str) -> str:
    """A text that is equal for sources that run equally."""
    return ast.dump(_Bare().visit(ast.parse(source)))


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Import hook that supplies the mutated source of one module."""

    def __init__(self, file: str, source: str) -> None:
        self.file, self.source = file, source

    def find_spec(self, fullname: str, path: object, target: object = None) -> object:
        del path, target
        if fullname != module_name(self.file):
            return None
        origin = str(PROJECT / self.file)
        return importlib.util.spec_from_loader(fullname, self, origin=origin)

    def get_source(self, fullname: str) -> str:
        del fullname
        return self.source


class _Hurried:
    """Pytest plugin that limits hypothesis to fewer examples, and skips shrinking."""

    @pytest.hookimpl
    def pytest_collection(self) -> None:
        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
        hypothesis.settings.register_profile(
            "mutants",
            phases=phases,
            database=None,
            derandomize=True,
            deadline=None,
            max_examples=30,
        )
        hypothesis.settings.load_profile("mutants")


def tests_fail(file: str, source: str) -> bool:
    """Check whether a unit test fails with this source; to be called once in a process."""
    if module_name(file) in sys.modules:
        raise RuntimeError(f"{file} was imported before its mutation")
    sys.meta_path.insert(0, _Mutated(file, source))
    tests = [str(PROJECT / "tests" / test) for test in UNIT_TESTS[file]]
    options = ["-x", "-q", "-W", "ignore", "-o", f"timeout={TEST_TIMEOUT_S}", "--rootdir=."]
    options += ["-p", "no:unraisableexception"]  # it collects garbage, which takes half the time
    with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stdout(nowhere):
        code = pytest.main([*options, *tests], plugins=[_Hurried()])
    if code not in {0, 1, 2}:
        raise RuntimeError(f"the tests of {file} could not run: pytest says {code!r}")
    return code != 0


def key_of(file: str, before: str, after: str) -> Key:
    """Key of a change: the enclosing function, the removed lines, the added lines."""
    old, new = before.splitlines(), after.splitlines()
    out: list[str] = []
    into: list[str] = []
    line = 0
    for tag, i1, i2, j1, j2 in difflib.SequenceMatcher(None, old, new, False).get_opcodes():
        if tag != "equal":
            line = line or i1 + 1
            out += [text.strip() for text in old[i1:i2]]
            into += [text.strip() for text in new[j1:j2]]
    return Key(file, _enclosing(before, line), _cell(out), _cell(into))


def _cell(lines: list[str]) -> str:
    """Join lines, without the blank that Cosmic Ray inserts before its replacement."""
    return re.sub(r"(?<=[(\[]) ", "", " ".join(" ".join(lines).split()))


def _enclosing(source: str, line: int) -> str:
    name = "module"
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
            if first <= line <= (node.end_lineno or 0):
                name = node.name
    return name


def judge(spec: Spec) -> Judged:
    """Make one mutant and run the tests on it."""
    gc.freeze()  # objects imported before the fork need no further garbage collection
    before = SOURCES[spec.file]
    visitor = MutationVisitor(spec.occurrence, operator(spec.operator, spec.file))
    after = visitor.walk(TREES[spec.file]).get_code()
    key = key_of(spec.file, before, after)
    try:
        same = what_runs(after) == what_runs(before)
    except SyntaxError:
        return Judged(spec, Outcome.KILLED, key)
    if same:
        return Judged(spec, Outcome.SAME, key)
    killed = tests_fail(spec.file, after)
    return Judged(spec, Outcome.KILLED if killed else Outcome.SURVIVED, key)


def unmutated_fails(file: str) -> bool:
    """Check whether the tests fail without a mutation: every result would then be worthless."""
    return tests_fail(file, SOURCES[file])


def argued(files: Iterable[str]) -> set[Key]:
    """Rows of docs/mutants.md for these files."""
    rows: set[Key] = set()
    for line in EQUIVALENTS.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) == 5 and cells[0].strip("`") in files:
            rows.add(Key(*(cell.replace("\\|", "|").strip("`").strip() for cell in cells[:4])))
    return rows


def main() -> int:
    """Run all mutants; 0 only if the rows of docs/mutants.md match the survivors exactly."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "files", nargs="*", default=list(MUTATED), help="of " + ", ".join(UNIT_TESTS)
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--inside", nargs="*", default=(), help="only what is in these functions")
    parser.add_argument("--again", action="store_true", help="only what survived the last time")
    options = parser.parse_args()
    os.chdir(PROJECT)
    specs = [spec for file in options.files for spec in specs_of(file, options.inside)]
    if options.again:
        last = {Spec(*one) for one in json.loads(SURVIVORS.read_text(encoding="utf-8"))}
        specs = [spec for spec in specs if spec in last]
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["__main__", *PRELOADED])
    with context.Pool(options.jobs, maxtasksperchild=1) as pool:
        for file in options.files:
            if pool.apply(unmutated_fails, [file]):
                Console().print(f"the tests of {file} fail without any mutation")
                return 1
        judged = list(_watched(pool.imap_unordered(judge, specs), len(specs)))
    survivors = [one.spec for one in judged if one.outcome is Outcome.SURVIVED]
    SURVIVORS.write_text(json.dumps(survivors), encoding="utf-8")
    return _report(options.files, judged, whole=not options.again and not options.inside)


def _watched(results: Iterable[Judged], total_count: int) -> Iterator[Judged]:
    """Yield the results as they arrive, with a progress bar on a terminal, else with lines."""
    console = Console()
    survived = 0
    with Progress(console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("mutants", total=total_count)
        for number, one in enumerate(results, 1):
            survived += one.outcome is Outcome.SURVIVED
            if one.outcome is Outcome.SURVIVED:
                told = (
                    f"{one.key.file} {one.key.function}\n  - {one.key.before}\n  + {one.key.after}"
                )
                progress.console.print(
                    f"survived: {told}", markup=False, highlight=False, soft_wrap=True
                )
            progress.update(task, advance=1, description=f"mutants ({survived} survived)")
            if not console.is_terminal and (number % 100 == 0 or number == total_count):
                print(f"{number}/{total_count} mutants, {survived} survived", flush=True)
            yield one


def _report(files: list[str], judged: list[Judged], *, whole: bool) -> int:
    rows = argued(files)
    survivors = {one.key for one in judged if one.outcome is Outcome.SURVIVED}
    table = Table("file", "mutants", "killed", "survived", "argued", "not argued")
    for file in files:
        counts = Counter(one.outcome for one in judged if one.spec.file == file)
        left = {key for key in survivors if key.file == file}
        mutants = counts[Outcome.KILLED] + counts[Outcome.SURVIVED]
        numbers = (mutants, counts[Outcome.KILLED], counts[Outcome.SURVIVED])
        table.add_row(file, *map(str, (*numbers, len(left & rows), len(left - rows))))
    Console().print(table)
    for key in sorted(survivors - rows):
        print(f"not argued: {key.file} {key.function}\n  - {key.before}\n  + {key.after}")
    stale = rows - survivors if whole else set()
    for key in sorted(stale):
        print(f"argued in {EQUIVALENTS.name}, and survives no more: {key}")
    return 1 if stale or survivors - rows else 0


if __name__ == "__main__":
    sys.exit(main())
