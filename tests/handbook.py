"""Does what a page of the handbook, or README.md, tells its reader, block by block, in a folder of its own.

Commands are run one after another, those of cosim in this process. In a ``console`` block with prompts the lines below
a command are what it prints, in which ``...`` stands for anything. A ``yaml`` block that begins with the name of a
file in a comment is that file; another is a part of the scenario of the page that was written last, and is checked as
one. A ``python`` block that begins so is a file too; others follow each other in one namespace, and a ``text`` block
right below one is what it prints. Below the line ``<!-- lines of FILE -->`` a block quotes a file of the checkout.

A block below the line ``<!-- not executed: why -->`` is left out. How a page is taken apart is in ``fresh.py``.
"""

import contextlib
import doctest
import io
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import indent
from typing import Any

import yaml

from cosim.cli import main
from cosim.scenario import Scenario
from tests.checkout import ROOT
from tests.fresh import PAGES, SHELLS, Block, Place, blocks, commands, named, provide, show, steps_of, told

PAGES_READ = sorted([ROOT / "README.md", *(path for path in ROOT.glob("docs/**/*.md"))])
EXECUTED = frozenset(("console", "yaml", "python"))
REASON = re.compile(r"<!-- not executed: (.+) -->")
QUOTED = re.compile(r"<!-- lines of (\S+) -->")
FULL = re.compile(r"cosim sweep (?:[a-z]\w*_\w+)(?= |$)(?!.*--replicates)")
"""The start of a sweep that has its full size."""
SHORT = "--quick --replicates 1 --set duration_s=5"
"""What makes such a sweep one of seconds."""
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


class PageError(AssertionError):
    """A block does not do what the page says: where, and what it did."""


@dataclass
class Reader:
    """Somebody who does what a page says, in *folder*."""

    page: Path
    folder: Path
    scenario: dict[str, Any] = field(default_factory=dict)
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__main__"})
    printed: str | None = None
    """By the last Python block, if nothing has followed it."""

    def follow(self) -> None:
        """Do all that the page says."""
        text = self.page.read_text(encoding="utf-8")
        mentioned = "\n".join(told(text).steps)
        for block in blocks(text):
            if not REASON.search(block.before):
                with self._blamed(block):
                    self._do(block, mentioned)

    @contextlib.contextmanager
    def _blamed(self, block: Block) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # a block of a page may raise anything; raised again with its line
            raise PageError(f"{title(self.page)}:{block.line}: {error}") from error

    def _do(self, block: Block, mentioned: str) -> None:
        before, self.printed = self.printed, None
        quoted = QUOTED.search(block.before)
        if quoted:
            source = (ROOT / quoted.group(1)).read_text(encoding="utf-8")
            if block.text not in source and indent(block.text, "    ") not in source:
                raise PageError(f"these are no lines of {quoted.group(1)}")
            return
        if block.language in SHELLS or block.language == "indented":
            for command in commands(block):
                self._type(command, answer_of(block, command))
        elif block.language == "yaml" or (block.language == "python" and named(block, mentioned)):
            self._write(block, named(block, mentioned))
        elif block.language == "python":
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(block.text, f"{self.page.name}:{block.line}", "exec"), self.names)
            self.printed = out.getvalue()
        elif block.language == "text" and before is not None:
            compare(block.text, before)

    def _write(self, block: Block, name: str | None) -> None:
        if name is not None:
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        if block.language == "python":
            return
        plain = yaml.safe_load(block.text)
        if name is None or "protocol" in plain:
            self.scenario = (self.scenario if name is None else {}) | plain
            Scenario.model_validate(self.scenario)

    def _type(self, command: str, answer: str) -> None:
        """Run *command*, and compare what it prints with *answer*, if that is told."""
        code, printed = 0, ""
        for step in steps_of(command):
            step = FULL.sub(lambda found: f"{found.group()} {SHORT}", step)
            if SHORT in step and " -o " not in step:
                step += f" -o results/{Path(step.split()[2]).name}"
            provide(Path.cwd(), step, told(self.page.read_text(encoding="utf-8")))
            if step.startswith("cosim sweep "):  # processes cost their start, and change nothing
                step = re.sub(r" --jobs \d+", "", step) + " --jobs 1"
            code, said = self._run(step)
            printed += said
            if code:
                break
        if code not in (0, 2) or (code == 2 and (not answer or "..." in answer)):
            raise PageError(f"{command}: exit code {code}\n{printed}")
        if answer:
            compare(answer, printed)

    def _run(self, step: str) -> tuple[int, str]:
        words = shlex.split(step)
        if words[0] == "cd":
            os.chdir(words[1])
            return 0, ""
        if words[0] == "cosim" and "|" not in words:
            if words[1] in PAGES:
                show(Place("", Path.cwd(), dict(os.environ)), words)
                return 0, ""
            return captured(lambda: main(words[1:]))
        if words[0] == "python" and words[1].endswith(".py"):
            return captured(lambda: runpy.run_path(words[1], run_name="__main__"), words[1:])
        if words[:3] == ["python", "-P", "-m"]:
            return captured(lambda: runpy.run_module(words[3], run_name="__main__", alter_sys=True), words[3:])
        if words[0] == "tshark" and not shutil.which("tshark") and not os.environ.get("CI"):
            return 0, ""  # the tests of captures say at the end that it is missing
        ended = subprocess.run(
            ["bash", "-o", "pipefail", "-c", step],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        return ended.returncode, ended.stdout


def captured(call: Any, arguments: list[str] | None = None) -> tuple[int, str]:
    """Return the exit code of *call*, and what it prints, with sys.argv *arguments*."""
    out, given = io.StringIO(), sys.argv
    sys.argv = arguments or given
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            call()
    except SystemExit as ended:
        return (ended.code if isinstance(ended.code, int) else int(ended.code is not None)), out.getvalue()
    finally:
        sys.argv = given
    return 0, out.getvalue()


def answer_of(block: Block, command: str) -> str:
    """Return the lines below *command* in a block with prompts, up to the next."""
    parts = re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]
    for part in parts:
        first, _, rest = re.sub(r"\s*\\\n\s*", " ", part).partition("\n")
        if first.partition("  ")[0].strip() == command or first.startswith(command):
            return rest.strip()
    return ""


def compare(told_text: str, printed: str) -> None:
    """Raise PageError unless *printed* is what the page tells."""
    if not doctest.OutputChecker().check_output(told_text.strip() + "\n", printed.strip() + "\n", FLAGS):
        raise PageError(f"it prints\n{printed}\nand the page says\n{told_text}")


def title(path: Path) -> str:
    """Return what a page is called."""
    return str(path.relative_to(ROOT) if path.is_relative_to(ROOT) else path.name)


def left_out(path: Path) -> list[str]:
    """Return where the page at *path* has blocks that are not executed, and why."""
    found = []
    for block in blocks(path.read_text(encoding="utf-8")):
        reason = REASON.search(block.before)
        if reason:
            found.append(f"{title(path)}:{block.line}: {reason.group(1)}")
    return found


def furnish(folder: Path) -> None:
    """Put into *folder* what a reader has who stands in the checkout, and programs that start cosim and python."""
    shutil.copytree(ROOT / "examples", folder / "examples", ignore=shutil.ignore_patterns("__pycache__", "results"))
    (folder / "experiments").mkdir()
    (folder / "experiments" / "floors").symlink_to(ROOT / "experiments" / "floors")
    (folder / "bin").mkdir()
    for name, words in {"cosim": "-m cosim", "python": ""}.items():
        program = folder / "bin" / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
        program.chmod(0o755)
