"""Random faults in product code: how many of them does the test suite find?

    python scripts/mutate_code.py coverage                       # which test runs which line; slow
    python scripts/mutate_code.py choose faults.json --count 300 --seed 38
    python scripts/mutate_code.py try faults.json                # a verdict for each, and the share

A fault is one change of one expression or statement inside a function: an operator or a comparison
swapped, a condition negated, a sign or a constant changed, a check dropped. It is found when a test
that runs its line fails or takes far longer than it did. Of these tests the cheapest come first, up
to `MAX_TESTS_S` seconds of CPU. Faults that change nothing that can be observed count as not found:
the share is for comparing suites. To try the same faults against another version, call `try` in its
checkout: a fault is located by the text of its function, and left out where that has changed.

Needs coverage and pytest-cov beside what the tests need.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import os
import random
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

PACKAGES = ("baxter_kin", "planner", "sim")
CODE = ("tests", "scripts", "notebooks", "examples", "docs", "urdf", *PACKAGES)
FILES = ("pyproject.toml", "README.md", "CHANGELOG.md", "CITATION.cff", "Makefile", "LICENSE")

MAX_TESTS_S = 40.0
"""CPU time of the tests that are tried for one fault, by the log of the run with coverage."""

MAX_TESTS = 80


@dataclass(frozen=True)
class Fault:
    """A changed piece of a function.

    `start` and `end` count bytes from the first line of the function, whose text has the hash
    `function_sha1`; `line` counts lines from there.
    """

    path: str
    function: str
    function_sha1: str
    line: int
    start: int
    end: int
    before: str
    after: str
    kind: str


# Choosing faults --------------------------------------------------------------------------------

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
NAMES = {
    "min": "max",
    "max": "min",
    "any": "all",
    "all": "any",
    "sin": "cos",
    "cos": "sin",
    "minimum": "maximum",
    "maximum": "minimum",
    "left": "right",
    "floor": "ceil",
    "ceil": "floor",
    "argmin": "argmax",
    "argmax": "argmin",
}


def changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Faulty versions of a node, each with the kind of the fault."""
    match node:
        case ast.Compare(ops=[operator]):
            for other in COMPARISONS[type(operator)]:
                yield "comparison", ast.Compare(node.left, [other()], node.comparators)
        case ast.BinOp() if type(node.op) in OPERATORS and not _is_text(node):
            yield "operator", ast.BinOp(node.left, OPERATORS[type(node.op)](), node.right)
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            yield "sign or not", node.operand
        case ast.BoolOp():
            other_op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            yield "and, or", ast.BoolOp(other_op, node.values)
        case ast.Constant(value=bool() | int() | float()):
            yield "constant", ast.Constant(_changed_number(node.value))
        case ast.Name() if node.id in NAMES:
            yield "name", ast.Name(NAMES[node.id])
        case ast.Attribute() if node.attr in NAMES:
            yield "name", ast.Attribute(node.value, NAMES[node.attr])
        case ast.IfExp():
            yield "condition", ast.IfExp(node.test, node.orelse, node.body)
        case ast.If(body=[ast.Raise() | ast.Return() | ast.Continue() | ast.Break()], orelse=[]):
            yield "dropped check", ast.Pass()
        case ast.Expr(value=ast.Call()):
            yield "dropped call", ast.Pass()


def _changed_number(value: object) -> bool | int | float:
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case _:
            return 2.0 * value or 1.0  # type: ignore[operator]


def _is_text(node: ast.BinOp) -> bool:
    return any(
        isinstance(side, ast.JoinedStr)
        or (isinstance(side, ast.Constant) and isinstance(side.value, str))
        for side in (node.left, node.right)
    )


@dataclass(frozen=True)
class Candidate:
    """A node of a function, and a faulty version of it."""

    path: Path
    function: str
    source: bytes
    first: int
    first_line: int
    node: ast.AST
    kind: str
    faulty: ast.AST

    def fault(self, root: Path, starts: list[int]) -> Fault:
        """The change of the text; `starts` has the first byte of each line of the module."""
        node: ast.expr = self.node  # type: ignore[assignment]
        start = starts[node.lineno - 1] + node.col_offset - self.first
        end = starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0) - self.first
        after = ast.unparse(self.faulty)
        return Fault(
            str(self.path.relative_to(root)),
            self.function,
            hashlib.sha1(self.source).hexdigest(),
            node.lineno - self.first_line,
            start,
            end,
            self.source[start:end].decode(),
            f"({after})" if isinstance(self.faulty, ast.expr) else after,
            self.kind,
        )


def candidates(path: Path) -> Iterator[Candidate]:
    """Every fault that can be put into the functions of a module."""
    text = path.read_bytes()
    starts = _line_starts(text)
    for name, function, source in functions(text):
        line = _first_line(function)
        for node in _executed(function):
            for kind, faulty in changes(node):
                yield Candidate(path, name, source, starts[line - 1], line, node, kind, faulty)


def functions(text: bytes) -> Iterator[tuple[str, ast.FunctionDef, bytes]]:
    """Outermost functions and methods of a module: qualified name, node, and source."""
    starts = _line_starts(text)

    def within(body: list[ast.stmt], prefix: str) -> Iterator[tuple[str, ast.FunctionDef, bytes]]:
        for node in body:
            if isinstance(node, ast.FunctionDef):
                source = text[starts[_first_line(node) - 1] : starts[node.end_lineno or 0]]
                yield prefix + node.name, node, source
            elif isinstance(node, ast.ClassDef):
                yield from within(node.body, f"{prefix}{node.name}.")

    return within(ast.parse(text).body, "")


def _line_starts(text: bytes) -> list[int]:
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    return starts


def _first_line(node: ast.FunctionDef) -> int:
    return min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])


def _executed(function: ast.FunctionDef) -> Iterator[ast.AST]:
    """Nodes of a function's body; annotations, messages of errors and f-strings excluded."""
    queue: list[ast.AST] = list(function.body)
    while queue:
        node = queue.pop()
        if isinstance(node, ast.JoinedStr | ast.Raise):
            continue
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            queue += node.body if isinstance(node.body, list) else [node.body]
            continue
        if isinstance(node, ast.AnnAssign):
            queue += [node.value] if node.value is not None else []
            continue
        if hasattr(node, "lineno"):
            yield node
        queue += list(ast.iter_child_nodes(node))


def choose(root: Path, count: int, seed: int) -> list[Fault]:
    """Faults drawn at random, functions in proportion to the number of their faults."""
    paths = sorted(path for package in PACKAGES for path in (root / package).rglob("*.py"))
    every = [candidate for path in paths for candidate in candidates(path)]
    drawn = random.Random(seed).sample(every, min(count, len(every)))
    return [found.fault(root, _line_starts(found.path.read_bytes())) for found in drawn]


# Trying them ------------------------------------------------------------------------------------


class Coverage:
    """Which tests run a line, and how much CPU time they take."""

    def __init__(self, database: Path, cpu_log: Path) -> None:
        self._connection = sqlite3.connect(database)
        self._files = {
            path: number for number, path in self._connection.execute("select id, path from file")
        }
        self._seconds: dict[str, float] = {}
        for line in cpu_log.read_text(encoding="utf-8").splitlines():
            seconds, node_id = line.split(" ", 1)
            self._seconds[node_id] = float(seconds)

    def tests_of(self, path: str, line: int) -> list[str]:
        """Node ids of tests that run a line, cheapest first, as many as the limits allow."""
        number = next((n for name, n in self._files.items() if name.endswith("/" + path)), None)
        rows = self._connection.execute(
            "select context, numbits from line_bits join context on context.id = context_id"
            " where file_id = ?",
            (number,),
        )
        runs = {
            context.split("|")[0]
            for context, bits in rows
            if context and line // 8 < len(bits) and bits[line // 8] >> line % 8 & 1
        }
        chosen: list[str] = []
        total_s = 0.0
        for node_id in sorted(runs & self._seconds.keys(), key=self._seconds.__getitem__):
            total_s += self._seconds[node_id]
            if chosen and (total_s > MAX_TESTS_S or len(chosen) == MAX_TESTS):
                break
            chosen.append(node_id)
        return chosen


def locate(fault: Fault, root: Path) -> tuple[Path, int, bytes] | None:
    """Where the function of a fault stands in a checkout: file, first line, text of the file."""
    path = root / fault.path
    for candidate in [path, *sorted(root.glob("*/**/*.py"))]:
        if not candidate.exists() or candidate.relative_to(root).parts[0] not in PACKAGES:
            continue
        text = candidate.read_bytes()
        last = fault.function.rpartition(".")[2].encode()
        if last not in text:
            continue
        for _, node, source in functions(text):
            if node.name.encode() == last and (
                hashlib.sha1(source).hexdigest() == fault.function_sha1
            ):
                return candidate, _first_line(node), text
    return None


def with_fault(fault: Fault, place: tuple[Path, int, bytes]) -> bytes:
    """The text of a module with a fault in it; `place` as `locate` gives it."""
    _, first_line, text = place
    first = _line_starts(text)[first_line - 1]
    return text[: first + fault.start] + fault.after.encode() + text[first + fault.end :]


def verdict(fault: Fault, tree: Path, coverage: Coverage) -> str:
    """What the tests make of a fault in a copy of the checkout."""
    place = locate(fault, tree)
    if place is None:
        return "changed"
    path, first_line, text = place
    tests = coverage.tests_of(str(path.relative_to(tree)), first_line + fault.line)
    if not tests:
        return "not run"
    cached = path.parent / "__pycache__"
    try:
        path.write_bytes(with_fault(fault, place))
        shutil.rmtree(cached, ignore_errors=True)
        return "found" if _fails(tests, tree) else "not found"
    finally:
        path.write_bytes(text)
        shutil.rmtree(cached, ignore_errors=True)


def _fails(tests: list[str], tree: Path) -> bool:
    """Whether one of the tests fails, or all together take too long."""
    arguments = tree / "tests_to_run.txt"
    arguments.write_text("\n".join(tests), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
    try:
        result = subprocess.run(
            [*command, f"@{arguments}"],
            cwd=tree,
            env={**os.environ, "CI": "true", "PYTHONPATH": str(tree)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=10 * MAX_TESTS_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return True
    return result.returncode != 0


def copy_of(root: Path, folder: Path) -> Path:
    """A copy of what tests read in a checkout."""
    for name in CODE:
        shutil.copytree(root / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy(root / name, folder / name)
    return folder


def record_coverage(root: Path, database: Path, cpu_log: Path) -> int:
    """Run the suite with coverage of each test; pytest's exit status."""
    configuration = database.with_suffix(".ini")
    sources = "\n    ".join(PACKAGES)
    configuration.write_text(f"[run]\nsource = {sources}\n", encoding="utf-8")
    cpu_log.unlink(missing_ok=True)
    options = ["--cov", f"--cov-config={configuration}", "--cov-context=test", "--cov-report="]
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "2", "--cpu-log", str(cpu_log), *options],
        cwd=root,
        env={**os.environ, "CI": "true", "COVERAGE_FILE": str(database)},
        check=False,
    ).returncode


def main() -> None:
    """Record coverage, choose faults, or try them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--coverage", type=Path, default=Path("build/coverage.db"))
    parser.add_argument("--cpu-log", type=Path, default=Path("build/cpu.log"))
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("coverage", help="run the suite with coverage of each test")
    choosing = commands.add_parser("choose", help="draw faults at random")
    choosing.add_argument("file", type=Path)
    choosing.add_argument("--count", type=int, default=300)
    choosing.add_argument("--seed", type=int, default=38)
    trying = commands.add_parser("try", help="try faults")
    trying.add_argument("file", type=Path)
    trying.add_argument("--verdicts", type=Path, help="append the verdicts here, and go on from it")
    options = parser.parse_args()
    root = Path(__file__).resolve().parent.parent
    if options.command == "coverage":
        options.coverage.parent.mkdir(parents=True, exist_ok=True)
        sys.exit(record_coverage(root, options.coverage.absolute(), options.cpu_log.absolute()))
    if options.command == "choose":
        faults = choose(root, options.count, options.seed)
        options.file.write_text(json.dumps([asdict(fault) for fault in faults], indent=1))
        return
    faults = [Fault(**data) for data in json.loads(options.file.read_text())]
    verdicts_file = options.verdicts or options.file.with_suffix(".verdicts.jsonl")
    done = verdicts_file.read_text().splitlines() if verdicts_file.exists() else []
    verdicts = [json.loads(line)["verdict"] for line in done]
    coverage = Coverage(options.coverage, options.cpu_log)
    with tempfile.TemporaryDirectory() as folder, verdicts_file.open("a") as file:
        tree = copy_of(root, Path(folder))
        for number, fault in enumerate(faults[len(verdicts) :], len(verdicts)):
            verdicts.append(verdict(fault, tree, coverage))
            line = {"fault": number, "verdict": verdicts[-1], **asdict(fault)}
            print(json.dumps(line), file=file, flush=True)
            print(f"{number} {verdicts[-1]}: {fault.path} {fault.function}, {fault.kind}: ", end="")
            print(f"{fault.before[:60]!r} -> {fault.after[:60]!r}", flush=True)
    tried = [outcome for outcome in verdicts if outcome != "changed"]
    found = tried.count("found")
    print(f"{found} of {len(tried)} faults found: {100 * found / max(len(tried), 1):.1f} %")


if __name__ == "__main__":
    main()
