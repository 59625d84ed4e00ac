"""Errors that are planted in the kernels of a package, to see whether tests find them.

A mutant is the source of a module with one small error in one of its kernels: another comparison or operator, a number
that is one off, a condition that is always or never met, a statement that is left out.

    python -m tests.mutants cosim.channels.adhoc.dcf FILE TESTS...

runs pytest on TESTS with the source in FILE in the place of a module. Kernels of its package are plain Python then: to
compile them anew for each error would take longer than the tests.
"""

import ast
import os
import random
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import spec_from_loader
from pathlib import Path
from types import CodeType, ModuleType
from typing import NamedTuple

import pytest

from tests.checkout import ROOT

OTHERS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Add,
    ast.FloorDiv: ast.Mult,
    ast.Div: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
"""What stands in the place of an operator."""
NAMES = {"min": "max", "max": "min"}


class Mutant(NamedTuple):
    """A module with an error."""

    module: str
    line: int
    before: str
    after: str
    source: str
    """The whole module with the error."""

    @property
    def text(self) -> str:
        """The line with the error, or the first of its lines."""
        return self.source.splitlines()[self.line - 1].strip()

    def __str__(self) -> str:
        return f"{self.module}:{self.line}: {self.before!r} -> {self.after!r}"


def drawn_mutants(sources: Mapping[str, str], count: int, seed: int) -> list[Mutant]:
    """Return *count* different mutants of the modules *sources*, all equally likely, in random order."""
    every = [mutant for module, source in sorted(sources.items()) for mutant in mutants(module, source)]
    return random.Random(seed).sample(every, count)


def mutants(module: str, source: str) -> Iterator[Mutant]:
    """Yield all mutants of the kernels of *module*."""
    lines = source.encode().splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    text = b"".join(lines)
    for function in ast.parse(source).body:
        if not isinstance(function, ast.FunctionDef) or "njit" not in map(_name, function.decorator_list):
            continue
        for statement in function.body[1:]:  # without the docstring
            for node in ast.walk(statement):
                for after in _replacements(node):
                    begin = starts[node.lineno - 1] + node.col_offset
                    end = starts[node.end_lineno - 1] + node.end_col_offset
                    before = text[begin:end].decode()
                    mutated = text[:begin] + after.encode() + text[end:]
                    yield Mutant(module, node.lineno, before, after, mutated.decode())


def _name(decorator: ast.expr) -> str:
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    return called.id if isinstance(called, ast.Name) else ""


def _replacements(node: ast.AST) -> Iterator[str]:
    """Yield what may stand in the place of *node*."""
    match node:
        case ast.Compare(ops=[operator]) if type(operator) in OTHERS:
            yield f"({ast.unparse(_changed(node, ops=[OTHERS[type(operator)]()]))})"
        case ast.BinOp(op=operator) if type(operator) in OTHERS:
            yield f"({ast.unparse(_changed(node, op=OTHERS[type(operator)]()))})"
        case ast.BoolOp(op=operator):
            yield f"({ast.unparse(_changed(node, op=OTHERS[type(operator)]()))})"
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield f"({ast.unparse(operand)})"
        case ast.Call(func=ast.Name(id=name)) if name in NAMES:
            yield ast.unparse(_changed(node, func=ast.Name(NAMES[name])))
        case ast.Constant(value=bool(value)):
            yield str(not value)
        case ast.Constant(value=int(value)):
            yield str(value + 1)
        case ast.If():
            for known in ("True", "False"):
                yield _unparsed(_changed(node, test=ast.Name(known)), node.col_offset)
        case ast.Assign(targets=[target]) if not _names(target):
            yield "pass"
        case ast.AugAssign() | ast.Expr():
            yield "pass"


def _names(target: ast.expr) -> bool:
    """Return whether an assignment to *target* makes a local name, without which the kernel could not go on at all."""
    return any(isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) for node in ast.walk(target))


def _changed(node: ast.AST, **fields: object) -> ast.AST:
    """Return a copy of *node* with other *fields*."""
    return type(node)(**{**dict(ast.iter_fields(node)), **fields})


def _unparsed(node: ast.AST, indentation: int) -> str:
    """Return the source of a statement, of which all lines but the first are indented."""
    return ast.unparse(node).replace("\n", "\n" + " " * indentation)


# ---------------------------------------------------------------- what tests say of a mutant


SHARE = 0.2
"""Part of the soak's cases that try to find a mutant."""


def is_found(mutant: Mutant, package: str, tests: Sequence[str], folder: Path, limit_s: float) -> bool:
    """Return whether one of *tests* fails with *mutant*, a module of *package*, or does not end within *limit_s*."""
    file = folder / f"{mutant.module}.py"
    file.write_text(mutant.source, encoding="utf-8")
    command = [sys.executable, "-m", "tests.mutants", f"{package}.{mutant.module}", str(file), *tests]
    wished = {**os.environ, "SOAK_SHARE": str(SHARE)}
    try:
        ended = subprocess.run(
            command, cwd=ROOT, env=wished, timeout=limit_s, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired:
        return True
    assert ended.returncode in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED), ended.stdout + ended.stderr
    return ended.returncode == pytest.ExitCode.TESTS_FAILED


def uncompiled(source: str) -> str:
    """Return the *source* of a module of kernels without what compiles them."""
    return re.sub(r"^@njit\(.*\)\n", "", source, flags=re.MULTILINE)


class _Plain(SourceFileLoader):
    """Loads a module without its decorators of kernels, from the source at *path*."""

    def get_code(self, fullname: str) -> CodeType:
        source = Path(self.path).read_text(encoding="utf-8")
        return compile(uncompiled(source), self.path, "exec")


class _Finder(MetaPathFinder):
    """Finds the modules of a package as plain Python, and one of them elsewhere."""

    def __init__(self, module: str, file: str) -> None:
        self._module, self._file = module, file
        self._package = module.rpartition(".")[0] + "."

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if not fullname.startswith(self._package):
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None or spec.submodule_search_locations is not None:
            return spec
        origin = self._file if fullname == self._module else str(spec.origin)
        return spec_from_loader(fullname, _Plain(fullname, origin), origin=origin)


def main(module: str, file: str, *tests: str) -> int:
    """Run *tests* with the source in *file* in the place of *module*; return pytest's exit code."""
    import cosim.jit

    cosim.jit.COMPILES = False  # type: ignore[misc]  # records are to have fields for plain Python
    sys.meta_path.insert(0, _Finder(module, file))
    return pytest.main(["-n", "0", "-x", "-q", "-p", "no:cacheprovider", *tests])


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
