"""Mutation testing of files behind the safety gates (`safety_gates.py`): `make mutants`.

Each mutant is one small change to one file, made in memory and never on disk. The unit tests of
that file run on it, and one of them must fail. `docs/evidence/mutants.md` must give a reason for
each survivor, row by row. A survivor without a row, and a row without a survivor, end the run with
exit code 1.

The mutations are those of Cosmic Ray and of `mutation_operators.py`. Cosmic Ray's own runner starts
Python and imports everything anew for each mutant, and writes into the work tree. Here one process
for each file imports and collects its tests once, and forks for each mutant. The fork replaces the
code of the changed function, and runs the tests, those that call this function and the likeliest
killers first. Where the change is outside of a function, or in one that runs while the module or
the tests are imported, a process imports the changed module anew.
"""

import argparse
import ast
import contextlib
import difflib
import functools
import gc
import hashlib
import importlib
import importlib.abc
import importlib.util
import inspect
import json
import math
import multiprocessing
import os
import re
import resource
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from enum import Enum
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import ClassVar, NamedTuple

PROJECT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(PROJECT), str(PROJECT / "scripts")]
sys.dont_write_bytecode = False
sys.pycache_prefix = str(PROJECT / ".venv" / "pycache")  # otherwise each process compiles the tests
RESULTS = PROJECT / ".venv" / "mutants"
"""Results of the last run, a file for each mutated file; `--again` adds to them."""
EQUIVALENTS = PROJECT / "docs/evidence/mutants.md"

import hypothesis  # noqa: E402 - after the path
import mutation_operators  # noqa: E402
import pytest  # noqa: E402
from cosmic_ray.ast import ast_nodes, get_ast  # noqa: E402
from cosmic_ray.mutating import MutationVisitor  # noqa: E402
from cosmic_ray.operators.operator import Operator  # noqa: E402
from cosmic_ray.operators.provider import OperatorProvider  # noqa: E402
from pages import MUTATED, code_digest  # noqa: E402
from parso.tree import NodeOrLeaf  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.progress import Progress  # noqa: E402
from rich.table import Table  # noqa: E402
from safety_gates import UNIT_TESTS, without_compiled_kernels  # noqa: E402

without_compiled_kernels()

SOURCES = {file: (PROJECT / file).read_text(encoding="utf-8") for file in UNIT_TESTS}

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

EQUIVALENT = re.compile(r"\b(slots|frozen|strict|kw_only)=$")
"""What is before a place that is not changed.

`slots` costs memory; nothing assigns to what is `frozen`, which the type checker knows; sequences
that `zip` pairs have equal lengths; `kw_only` is how arguments are passed.
"""

PRELOADED = (
    *("hypothesis.stateful", "_hypothesis_pytestplugin", "pytest_timeout", "numpy"),
    *("numba", "canopen", "msgspec", "zenoh"),
)
"""Slow imports of the tests, without any module that imports a mutated one."""

TEST_TIMEOUT_S = 60
"""Limit for a test of a mutant that waits for ever, while its usual time is not known."""
TEST_TIMEOUT_RATIO, TEST_TIMEOUT_MIN_S = 10, 5
"""Limit once it is known: so many times what the test takes without mutation, and not less."""
CPU_LIMIT_S = 30
"""Limit for all tests of a mutant that loops for ever."""


class Outcome(Enum):
    """Result of a mutant."""

    KILLED = "killed"
    SURVIVED = "survived"
    SAME = "same"
    """The change touches an annotation, a docstring or nothing: Python runs the same code."""
    UNDECIDED = "undecided"
    """The code cannot be replaced in a process that has imported it."""


class Spec(NamedTuple):
    """One mutation: the file, the operator, and the number of its occurrence."""

    file: str
    operator: str
    occurrence: int


class Key(NamedTuple):
    """Identification of a mutant in docs/evidence/mutants.md."""

    file: str
    function: str
    before: str
    after: str


class Judged(NamedTuple):
    """A mutant and its result."""

    spec: Spec
    outcome: Outcome
    key: Key
    source: str = ""
    """The mutated file, while the outcome is undecided."""


def module_name(file: str) -> str:
    """Module name of a path: `daemon.core.modes.table` for `daemon/core/modes/table.py`."""
    return file.removesuffix(".py").replace("/", ".")


@functools.cache
def tree(file: str) -> NodeOrLeaf:
    """Syntax tree of a file; each process changes its own copy after the fork."""
    return get_ast(SOURCES[file])


@functools.cache
def namespace(file: str) -> dict[str, object]:
    """Execute a file without mutation, and return its names."""
    spec = importlib.util.spec_from_file_location("unmutated", PROJECT / file)
    if spec is None or spec.loader is None:
        raise RuntimeError(f"{file} cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules["unmutated"] = module  # dataclasses look their module up here
    spec.loader.exec_module(module)
    return vars(module)


def operator(name: str, file: str) -> Operator:
    """Create an operator by its name; those of this project read the module to be changed."""
    ours = getattr(mutation_operators, name, None)
    return ours(namespace(file), SOURCES[file]) if ours else OperatorProvider()[name]()


def specs_of(file: str, functions: Collection[str]) -> Iterator[Spec]:
    """Every mutation of a file by any operator, or only those in the given functions."""
    nodes, lines = list(ast_nodes(tree(file))), SOURCES[file].splitlines()
    ours = [one.__name__ for one in mutation_operators.OPERATORS]
    for name in [*(n for n in OperatorProvider() if not LEFT_OUT.search(n)), *ours]:
        one = operator(name, file)
        places = [place for node in nodes for place in one.mutation_positions(node)]
        for number, ((line, column), _) in enumerate(places):
            if EQUIVALENT.search(lines[line - 1][:column]):
                continue
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
        return ast.Pass() if isinstance(node.value, ast.Constant) else self.generic_visit(node)


def what_runs(source: str) -> tuple[str, ...]:
    """Texts of the statements of a module that are equal for sources that run equally."""
    lines = source.splitlines()
    places = ((_first_line(one), one.end_lineno) for one in ast.parse(source).body)
    return tuple(_what_runs_of("\n".join(lines[first - 1 : last])) for first, last in places)


@functools.cache
def _what_runs_of(statement: str) -> str:
    """A fork finds all but the changed statement in the cache."""
    return ast.dump(_Bare().visit(ast.parse(statement)))


def _first_line(node: ast.stmt) -> int:
    decorators: list[ast.expr] = getattr(node, "decorator_list", [])
    return min([node.lineno, *(one.lineno for one in decorators)])


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


def run_pytest(file: str, *plugins: object) -> int:
    """Run the unit tests of a file up to the first that fails, and return pytest's exit code."""
    tests = [str(PROJECT / "tests" / test) for test in UNIT_TESTS[file]]
    options = ["-x", "-q", "-W", "ignore", "-o", f"timeout={TEST_TIMEOUT_S}", "--rootdir=."]
    options += ["-p", "no:unraisableexception"]  # it collects garbage, which takes half the time
    options += ["--tb=native"]
    options += ["--assert=plain"]  # its import hook takes `..._test.py` for tests, before ours
    with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stdout(nowhere):
        return int(pytest.main([*options, *tests], plugins=[_Hurried(), *plugins]))


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
    around = [name for first, last, name in _definitions(source) if first <= line <= last]
    return around[-1] if around else "module"


@functools.cache
def _definitions(source: str) -> list[tuple[int, int, str]]:
    """First line, last line and name of each function and class, outer ones first."""
    return [
        (_first_line(node), node.end_lineno or 0, node.name)
        for node in ast.walk(ast.parse(source))
        if isinstance(node, (ast.FunctionDef, ast.ClassDef))
    ]


def changed_functions(before: CodeType, after: CodeType) -> list[tuple[CodeType, CodeType]] | None:
    """Outermost functions that differ; None if code of the module or of a class differs."""
    if before.co_flags & inspect.CO_OPTIMIZED:
        return [] if _what_runs(before) == _what_runs(after) else [(before, after)]
    if _what_runs(before, nested=False) != _what_runs(after, nested=False):
        return None
    changed: list[tuple[CodeType, CodeType]] = []
    for old, new in zip(_nested(before), _nested(after), strict=True):
        inside = changed_functions(old, new)
        if inside is None:
            return None
        changed += inside
    return changed


def _what_runs(code: CodeType, *, nested: bool = True) -> tuple[object, ...]:
    """Everything of a code object but its place in the file."""
    constants = [
        (_what_runs(one) if nested else None) if isinstance(one, CodeType) else repr(one)
        for one in code.co_consts
    ]
    arguments = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount)
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    return code.co_code, constants, code.co_exceptiontable, code.co_flags, arguments, names


def _nested(code: CodeType) -> list[CodeType]:
    return [one for one in code.co_consts if isinstance(one, CodeType)]


class Place(NamedTuple):
    """Identification of a code object in its file."""

    line: int
    name: str

    @classmethod
    def of(cls, code: CodeType) -> "Place":
        """Place of a code object."""
        return cls(code.co_firstlineno, code.co_qualname)


def places_within(code: CodeType) -> set[Place]:
    """Places of a code object and of everything that is nested in it."""
    return {Place.of(code)}.union(*(places_within(one) for one in _nested(code)))


class Run(NamedTuple):
    """What a test does without mutation."""

    places: frozenset[Place]
    """Code of the file that it runs; what the test of a file caches is run by the first one."""
    cpu_s: float
    elapsed_s: float

    @property
    def timeout_s(self) -> float:
        """Limit for the test when a mutant makes it wait."""
        return max(TEST_TIMEOUT_MIN_S, TEST_TIMEOUT_RATIO * self.elapsed_s)


class _InForks:
    """Pytest plugin that forks for each mutant; a hook that returns None lets a fork go on."""

    codes: ClassVar = frozenset({0, 1, 2})
    """What pytest ends a fork with: all passed, one failed, a file could not be collected."""

    def __init__(self, report: Callable[[Judged], None]) -> None:
        self.report = report
        self.to_parent: Connection | None = None
        """Open in a fork."""
        self.kills: Counter[str] = Counter()
        """Mutants that each test has killed."""

    @pytest.hookimpl
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Send the name of the test that kills the mutant."""
        if report.failed and self.to_parent:
            self.to_parent.send(report.nodeid)

    def finish(self, judged: Judged, child: int, receive: Connection) -> Judged:
        """Wait for a fork; a negative code says that it has exceeded a limit."""
        with contextlib.suppress(EOFError):
            self.kills[receive.recv()] += 1
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if code not in self.codes and code >= 0:
            raise RuntimeError(f"the tests of {judged.spec} could not run: pytest says {code}")
        return judged._replace(outcome=Outcome.KILLED if code else Outcome.SURVIVED, source="")


class _AfterCollection(_InForks):
    """Forks after the tests are collected, and replaces code in each fork."""

    def __init__(self, file: str, specs: Iterable[Spec], report: Callable[[Judged], None]) -> None:
        super().__init__(report)
        self.file, self.specs = file, specs
        self.path = str(PROJECT / file)
        self.fails_unmutated = True
        self._seen: set[Place] = set()
        self._runs: list[Run] = []

    def trace(self, frame: FrameType, event: str, argument: object) -> None:
        """Profiler that collects the code of the file that runs."""
        del argument
        if event == "call" and frame.f_code.co_filename == self.path:
            self._seen.add(Place.of(frame.f_code))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Measure one test, in the fork without mutation."""
        del item
        self._seen = set()
        start_s, cpu_start_s = time.monotonic(), time.process_time()
        result = yield
        cpu_s, elapsed_s = time.process_time() - cpu_start_s, time.monotonic() - start_s
        self._runs.append(Run(frozenset(self._seen), cpu_s, elapsed_s))
        return result

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool | None:
        """Fork for each mutant; in a fork, return None and let pytest run `session.items`."""
        imported = frozenset(self._seen)
        items = list(session.items)
        receive, send = multiprocessing.Pipe(duplex=False)
        child = os.fork()
        if child == 0:
            self.to_parent = send
            return None
        sys.setprofile(None)
        send.close()
        runs: list[Run] = receive.recv()
        if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != 0:
            return True
        self.fails_unmutated = False
        for item, run in zip(items, runs, strict=True):
            item.add_marker(pytest.mark.timeout(run.timeout_s), append=False)
        before = compile(SOURCES[self.file], self.path, "exec")
        functions: dict[Place, list[FunctionType]] = {}
        gc.unfreeze()  # `tests/conftest.py` has frozen them, and frozen objects are not listed
        for one in gc.get_objects():
            if type(one) is FunctionType and one.__code__.co_filename == self.path:
                functions.setdefault(Place.of(one.__code__), []).append(one)
        namespace(self.file), tree(self.file), bare(self.file), _definitions(SOURCES[self.file])
        gc.freeze()  # objects from before the fork need no further garbage collection
        for spec in self.specs:
            receive, send = multiprocessing.Pipe(duplex=False)
            child = os.fork()
            if child == 0:
                mutant = mutate(spec)
                reached = None
                if mutant.outcome is Outcome.UNDECIDED:
                    reached = self._replace(before, mutant.source, functions, imported)
                send.send((mutant, reached is not None))
                if reached is None:
                    os._exit(0)
                limit_cpu(3 + 2 * sum(run.cpu_s for run in runs))
                self.to_parent = send
                session.items[:] = self._in_order(items, runs, reached)
                return None
            send.close()
            judged, is_tested = receive.recv()
            result = self.finish(judged, child, receive)
            self.report(result if is_tested else judged)
        return True

    def _replace(
        self,
        before: CodeType,
        source: str,
        functions: dict[Place, list[FunctionType]],
        imported: frozenset[Place],
    ) -> set[Place] | None:
        """Replace the code that differs, and return its places; None where that is not enough."""
        changed = changed_functions(before, compile(source, self.path, "exec"))
        if not changed:
            return None
        reached: set[Place] = set()
        for old, new in changed:
            place = Place.of(old)
            reached |= places_within(old)
            if reached & imported or old.co_freevars != new.co_freevars or place not in functions:
                return None
            for function in functions[place]:
                function.__code__ = new
        return reached

    def _in_order(
        self, items: list[pytest.Item], runs: list[Run], reached: set[Place]
    ) -> list[pytest.Item]:
        """All tests: first those that run what is changed, by kills per CPU-second."""

        def rank(number: int) -> tuple[bool, float]:
            run, kills = runs[number], self.kills[items[number].nodeid]
            return not run.places & reached, run.cpu_s / (1 + kills)

        return [items[number] for number in sorted(range(len(items)), key=rank)]

    @pytest.hookimpl
    def pytest_sessionfinish(self) -> None:
        """Send what the tests do without mutation, in the first fork."""
        if self.to_parent and self.fails_unmutated:
            self.to_parent.send(self._runs)


class _BeforeImport(_InForks):
    """Forks before any file of the tests is imported, which then import the mutated module."""

    codes = _InForks.codes | {3, 4}
    """Also an internal error and a wrong use: a plugin or a conftest.py cannot be imported."""

    def __init__(self, undecided: Iterable[Judged], report: Callable[[Judged], None]) -> None:
        super().__init__(report)
        self.undecided = undecided

    @pytest.hookimpl(tryfirst=True)
    def pytest_load_initial_conftests(self) -> None:
        """Fork for each mutant; a fork returns, and pytest collects and runs the tests."""
        for one in self.undecided:
            if module_name(one.spec.file) in sys.modules:
                raise RuntimeError(f"{one.spec.file} was imported before its mutation")
            receive, send = multiprocessing.Pipe(duplex=False)
            child = os.fork()
            if child == 0:
                self.to_parent = send
                limit_cpu(CPU_LIMIT_S)
                sys.meta_path.insert(0, _Mutated(one.spec.file, one.source))
                return
            send.close()
            self.report(self.finish(one, child, receive))
        os._exit(0)

    @pytest.hookimpl
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Run the test first that has killed the most."""
        items.sort(key=lambda item: -self.kills[item.nodeid])


def limit_cpu(limit_s: float) -> None:
    """End this process after so much CPU time, without a dump."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit_s), resource.RLIM_INFINITY))


@functools.cache
def bare(file: str) -> tuple[str, ...]:
    """Texts of what Python runs of a file without mutation."""
    return what_runs(SOURCES[file])


def mutate(spec: Spec) -> Judged:
    """Make a mutant; to be called once in a process, as it changes the syntax tree."""
    visitor = MutationVisitor(spec.occurrence, operator(spec.operator, spec.file))
    after = visitor.walk(tree(spec.file)).get_code()
    key = key_of(spec.file, SOURCES[spec.file], after)
    try:
        same = what_runs(after) == bare(spec.file)
    except SyntaxError:
        return Judged(spec, Outcome.KILLED, key)
    return Judged(spec, Outcome.SAME, key) if same else Judged(spec, Outcome.UNDECIDED, key, after)


def judge_replaced(send: Connection, file: str, specs: list[Spec]) -> None:
    """Process: judge mutants of one file; some of the results that it sends are undecided."""
    forks = _AfterCollection(file, specs, send.send)
    sys.setprofile(forks.trace)
    code = run_pytest(file, forks)
    if forks.to_parent:
        os._exit(code)
    if forks.fails_unmutated:
        raise RuntimeError(f"the tests of {file} fail without any mutation")
    if code:
        raise RuntimeError(f"the tests of {file} could not run: pytest says {code}")


def judge_imported(send: Connection, file: str, undecided: list[Judged]) -> None:
    """Process: judge mutants by all tests of their file, with the module imported anew for each."""
    os._exit(run_pytest(file, _BeforeImport(undecided, send.send)))  # of a fork


def argued(files: Iterable[str]) -> set[Key]:
    """Rows of docs/evidence/mutants.md for these files."""
    rows: set[Key] = set()
    for line in MUTATED.sub("", EQUIVALENTS.read_text(encoding="utf-8")).splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) == 5 and cells[0].strip("`") in files:
            rows.add(Key(*(cell.replace("\\|", "|").strip("`").strip() for cell in cells[:4])))
    return rows


def earlier_results(file: str) -> list[Judged]:
    """Results of earlier runs, if the file has not changed since."""
    try:
        header, *lines = results_file(file).read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return []
    if header != fingerprint(file):
        return []
    return [
        Judged(Spec(*spec), Outcome(outcome), Key(*key))
        for spec, outcome, key in map(json.loads, lines)
    ]


def results_file(file: str) -> Path:
    """Results for one mutated file: its fingerprint, and a line for each result."""
    return RESULTS / f"{module_name(file)}.jsonl"


def fingerprint(file: str) -> str:
    """Digest of a file and of the operators: equal ones make the same mutants."""
    operators = Path(mutation_operators.__file__).read_bytes()
    return hashlib.sha256(SOURCES[file].encode() + operators).hexdigest()


def in_processes(
    work: Callable[..., None], parts: Iterable[tuple[object, ...]]
) -> Iterator[Judged]:
    """Call `work(connection, *part)` in a process for each part; yields what they send."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["__main__", *PRELOADED])
    running: dict[Connection, multiprocessing.process.BaseProcess] = {}
    for part in parts:
        receive, send = context.Pipe(duplex=False)
        process = context.Process(target=work, args=(send, *part))
        process.start()
        send.close()
        running[receive] = process
    while running:
        for receive in wait(list(running)):
            try:
                yield receive.recv()
            except EOFError:
                process = running.pop(receive)
                process.join()
                if process.exitcode:
                    raise SystemExit(process.exitcode) from None  # it has told why


def judge(file: str, specs: list[Spec], jobs: int) -> Iterator[Judged]:
    """Judge the mutants of one file with so many processes; yields the results as they arrive."""
    undecided: list[Judged] = []
    parts = ((file, part) for number in range(jobs) if (part := specs[number::jobs]))
    for one in in_processes(judge_replaced, parts):
        if one.outcome is Outcome.UNDECIDED:
            undecided.append(one)
        else:
            yield one
    parts = ((file, part) for number in range(jobs) if (part := undecided[number::jobs]))
    yield from in_processes(judge_imported, parts)


def stored(file: str, results: Iterable[Judged], *, anew: bool) -> Iterator[Judged]:
    """Write each result to `results_file`, and yield it."""
    path = results_file(file)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w" if anew else "a", encoding="utf-8") as out:
        if anew:
            print(fingerprint(file), file=out)
        for one in results:
            print(json.dumps([one.spec, one.outcome.value, one.key]), file=out, flush=True)
            yield one


def main() -> int:
    """Run all mutants; 0 only if the rows of docs/evidence/mutants.md are the survivors exactly."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "files", nargs="*", default=list(UNIT_TESTS), help="of " + ", ".join(UNIT_TESTS)
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--inside", nargs="*", default=(), help="only what is in these functions")
    parser.add_argument(
        "--again",
        action="store_true",
        help="only what survived the last time, or was not reached, while the file is the same; a"
        " killed mutant is not tried with tests that have changed: only a whole run is a verdict",
    )
    options = parser.parse_args()
    os.chdir(PROJECT)
    known: dict[Spec, Judged] = {}
    for number, file in enumerate(options.files, 1):
        specs = list(specs_of(file, options.inside))
        earlier = earlier_results(file) if options.again else []
        decided = {one.spec: one for one in earlier if one.outcome is not Outcome.SURVIVED}
        known |= {spec: decided[spec] for spec in specs if spec in decided}
        specs = [spec for spec in specs if spec not in decided]
        results = stored(file, judge(file, specs, options.jobs), anew=not earlier)
        title = f"{number}/{len(options.files)} {file}"
        known |= {one.spec: one for one in _watched(title, results, len(specs))}
    judged = list(known.values())
    if not options.inside and not options.again:
        write_numbers(options.files, judged)
    return _report(options.files, judged, whole=not options.inside)


def _watched(title: str, results: Iterable[Judged], total_count: int) -> Iterator[Judged]:
    """Yield the results as they arrive, with a progress bar on a terminal, else with lines."""
    console = Console()
    survived = 0
    with Progress(console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task(title, total=total_count)
        for number, one in enumerate(results, 1):
            survived += one.outcome is Outcome.SURVIVED
            if one.outcome is Outcome.SURVIVED:
                told = (
                    f"{one.key.file} {one.key.function}\n  - {one.key.before}\n  + {one.key.after}"
                )
                progress.console.print(
                    f"survived: {told}", markup=False, highlight=False, soft_wrap=True
                )
            progress.update(task, advance=1, description=f"{title} ({survived} survived)")
            if not console.is_terminal and (number % 100 == 0 or number == total_count):
                print(f"{title}: {number}/{total_count}, {survived} survived", flush=True)
            yield one


def _report(files: list[str], judged: list[Judged], *, whole: bool) -> int:
    rows = argued(files)
    survivors = {one.key for one in judged if one.outcome is Outcome.SURVIVED}
    table = Table("file", "mutants", "killed", "survived", "argued", "not argued")
    for file in files:
        mutants, survived, not_argued = numbers(file, judged)
        argued_count = len({key for key in survivors if key.file == file} & rows)
        counts = (mutants, mutants - survived, survived, argued_count, not_argued)
        table.add_row(file, *map(str, counts))
    Console().print(table)
    for key in sorted(survivors - rows):
        print(f"not argued: {key.file} {key.function}\n  - {key.before}\n  + {key.after}")
    stale = rows - survivors if whole else set()
    for key in sorted(stale):
        print(f"argued in {EQUIVALENTS.name}, and survives no more: {key}")
    return 1 if stale or survivors - rows else 0


def numbers(file: str, judged: Iterable[Judged]) -> tuple[int, int, int]:
    """Mutants of a file that count, survivors, and those without a row in the page."""
    own = [one for one in judged if one.spec.file == file]
    counts = Counter(one.outcome for one in own)
    survivors = {one.key for one in own if one.outcome is Outcome.SURVIVED}
    survived = counts[Outcome.SURVIVED]
    return counts[Outcome.KILLED] + survived, survived, len(survivors - argued([file]))


def write_numbers(files: Iterable[str], judged: Collection[Judged]) -> None:
    """Write the rows of these files, mutated in full, into the numbers of the page."""
    text = EQUIVALENTS.read_text(encoding="utf-8")
    old = list(MUTATED.finditer(text))
    rows = {row[1]: row[0] for row in old if row[1] in UNIT_TESTS}
    for file in files:
        cells = (file, *numbers(file, judged), code_digest(PROJECT / file))
        rows[file] = f"| {' | '.join(map(str, cells))} |\n"
    table = "".join(rows[file] for file in sorted(rows))
    text = text[: old[0].start()] + table + text[old[-1].end() :]
    EQUIVALENTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
