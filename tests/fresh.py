"""Does what README.md tells a new user, line by line, on a fresh clone: ``make fresh``, or ``python tests/fresh.py``.

The commands are those of the README's sh blocks, and of its indented blocks in which every line begins with a program;
what follows two spaces is a remark. They run one after another, first in a clone of HEAD that is installed as they
say, then elsewhere with the wheel. Home, kernel cache and virtual environments are new; only Python is there.

A block is a file if its name is told: by its first line (``# four.yaml``), by the words before it, which end with
the name in backquotes and a colon, or by its key ``name: scout`` where a command names scout.yaml. Python lines
without a name are run where they stand. A file that no block tells and whose name begins with ``my`` stands for
something of the user's: a map after ``map=``, else a scenario.

Each command must end with 0 and have made the files that it names; a page is fetched and its command interrupted.
"""

import argparse
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple
from urllib.request import urlopen

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = frozenset(
    ("make", "cosim", "python", "python3", "pip", "git", "cd", ".", "source", "eval", "echo", "tshark")
)
SHELLS = frozenset(("sh", "bash", "shell", "console"))
LONG_S = 3600
"""No command may take longer."""
PAGES = ("view", "playbook")
FILE = r"[\w./-]+\.(?:yaml|py)"


# ---------------------------------------------------------------- what the README says


class Block(NamedTuple):
    """Lines that stand apart: fenced, with a language or none, or indented."""

    line: int
    language: str
    """``indented`` for lines that are not fenced."""
    before: str
    """The text line above it, if there is one between it and the last block."""
    text: str


def blocks(text: str) -> Iterator[Block]:
    """Yield the blocks of a page of Markdown in order."""
    lines = text.splitlines()
    before, at = "", 0
    while at < len(lines):
        start = at
        if lines[at].startswith("```"):
            at = next(number for number in range(at + 1, len(lines)) if lines[number].startswith("```"))
            yield Block(start + 1, lines[start][3:].strip(), before, "\n".join(lines[start + 1 : at]) + "\n")
            before = ""
        elif lines[at].startswith("    ") and (start == 0 or not lines[at - 1].strip()):
            while at < len(lines) and (lines[at].startswith("    ") or not lines[at].strip()):
                at += 1
            at -= 1
            yield Block(start + 1, "indented", before, "\n".join(line[4:] for line in lines[start : at + 1]) + "\n")
            before = ""
        elif lines[at].strip():
            before = lines[at]
        at += 1


def commands(block: Block) -> list[str]:
    """Return the commands of *block*, without remarks; none if it holds something else."""
    if block.language not in {*SHELLS, "indented"}:
        return []
    lines = re.sub(r"\s*\\\n\s*", " ", block.text).splitlines()
    if any(line.startswith("$ ") for line in lines):  # the others are what is printed
        lines = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
    lines = [line for line in map(without_remark, lines) if line and not line.startswith("#")]
    if block.language == "indented" and not all(program_of(line) in PROGRAMS for line in lines):
        return []
    return lines


def without_remark(line: str) -> str:
    """Return *line* up to two spaces outside quotes: what follows is for the reader."""
    bare = re.match(r"""\s*(?:'[^']*'|"[^"]*"|\s(?!\s)|[^\s'"])*""", line)
    return re.sub(r"\s#\s.*", "", bare.group() if bare else line).strip()


def steps_of(line: str) -> list[str]:
    """Return the commands that ``&&``, outside quotes, joins in *line*."""
    parts = re.findall(r"""(?:'[^']*'|"[^"]*"|(?! && )[^'"])+""", line)
    return [part.strip().removeprefix("&& ") for part in parts]


def program_of(command: str) -> str:
    """Return the program that *command* calls; a path in a virtual environment is that of the program."""
    word = next((word for word in command.split() if not re.match(r"\w+=", word)), "")
    return word.removeprefix(".venv/bin/")


def named(block: Block, mentioned: str) -> str | None:
    """Return the file that *block* is, if it is one; *mentioned* is all that commands say."""
    ways = (
        re.match(rf"# ?({FILE})\b", block.text),
        re.search(rf"`({FILE})`[^`]*:$", block.before),
    )
    for way in ways:
        if way:
            return way.group(1)
    key = re.match(r"name: (\w+)\n", block.text)
    return f"{key.group(1)}.yaml" if key and f"{key.group(1)}.yaml" in mentioned else None


@dataclass
class Told:
    """What a page tells the user to do, in order, and the files for it."""

    steps: list[str] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)


def told(text: str) -> Told:
    """Read a page of Markdown."""
    found = list(blocks(text))
    mentioned = "\n".join(line for block in found for line in commands(block))
    page = Told()
    for block in found:
        page.steps += [step for line in commands(block) for step in steps_of(line)]
        if block.language in {*SHELLS, "indented"}:
            continue
        name = named(block, mentioned)
        if name is None and block.language == "python":
            name = f"readme_{block.line}.py"
            page.steps.append(f"python {name}")
        if name is not None:
            page.files[name] = block.text
    return page


# ---------------------------------------------------------------- doing it


@dataclass
class Place:
    """Where the commands are typed."""

    name: str
    folder: Path
    environment: dict[str, str]
    clone: Path | None = None
    """Where the checkout is, if this is elsewhere."""
    failed: list[str] = field(default_factory=list)


class StepError(Exception):
    """A command that did not end as it should: why, and what it has printed."""


def do(place: Place, step: str, page: Told, everything: bool) -> None:
    """Do one step, and print a line with its time, or why it is left out; what a command prints, if it fails."""
    reason = left_out(place, step, page, everything)
    if reason is not None:
        print(f"       -    {step}   [left out: {reason}]", flush=True)
        return
    step = step if everything else shortened(step)
    provide(place.folder, step, page)
    begun = time.monotonic()
    wrong = None
    try:
        perform(place, step)
    except StepError as error:
        wrong = str(error)
        place.failed.append(step)
    print(f"{time.monotonic() - begun:8.1f} s  {step}{'' if wrong is None else '   FAILED'}", flush=True)
    if wrong is not None:
        print("\n".join(f"    | {line}" for line in wrong.splitlines()), flush=True)


def left_out(place: Place, step: str, page: Told, everything: bool) -> str | None:
    """Return why *step* is not done at *place*; None if it is."""
    program, words = program_of(step), step.split()
    if program == "git" or program == "cd":
        return "the clone is there"
    if program == "tshark" and shutil.which("tshark") is None:
        return "tshark is not installed"
    if program == "make" and "fresh" in words:
        return "this is it"
    if place.clone is not None and (program in ("make", "pip", ".", "source") or "venv" in words):
        return "the wheel is installed"
    if place.clone is not None:
        of_clone = [word for word in words if "/" in word and (place.clone / word).exists() and word not in page.files]
        if of_clone and not (place.folder / of_clone[0]).exists():
            return f"{of_clone[0]} is in the checkout only"
    if program == "make" and not everything and not {"run", "setup"} & {*words}:
        return "long; --all does it"
    return None


def shortened(step: str) -> str:
    """Return a sweep in its quick version, into the folder of the full one, where the README looks for results."""
    words = step.split()
    if words[:2] != ["cosim", "sweep"] or "--quick" in words:
        return step
    return f"{step} --quick -o results/{Path(words[2]).name}"


def provide(folder: Path, step: str, page: Told) -> None:
    """Write the files of the user's that *step* names and the page does not tell."""
    for name in {*re.findall(r"\bmy\w*\.yaml", step)} - page.files.keys():
        if f"map={name}" in step:
            width, height = 200, 120
            rows = [
                bytes(254 * (0 < x < width - 1 and 0 < y < height - 1) for x in range(width)) for y in range(height)
            ]
            (folder / "my_floor.pgm").write_bytes(b"P5 %d %d 255\n" % (width, height) + b"".join(rows))
            grey = "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
            (folder / name).write_text(f"image: my_floor.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n{grey}")
        else:
            (folder / name).write_text(next(text for name, text in page.files.items() if name.endswith(".yaml")))


def perform(place: Place, step: str) -> None:
    """Run one command; raise StepError unless it ends well and has made what it names."""
    words = shlex.split(step)
    if words[0] in (".", "source"):
        activate(place, words[1])
    elif words[:1] == ["cosim"] and words[1] in PAGES:
        show(place, words)
    else:
        if words[1:3] == ["-m", "venv"]:  # it is to be made, not to be found
            shutil.rmtree(place.folder / words[3], ignore_errors=True)
        code, said = run(place, ["bash", "-o", "pipefail", "-c", step])
        if code:
            raise StepError(f"exit code {code}\n{said}")
        missing = [name for name in made_by(words, said) if not any_content(place.folder / name)]
        if missing:
            raise StepError(f"{missing[0]} is not there\n{said}")


def made_by(words: list[str], said: str) -> list[str]:
    """Return the files and folders that a command makes."""
    options = ("--trace", "--pcapng", "-o", ">")
    pictures = [word for word in words if word.endswith(".png")]
    return [
        *(value for option, value in pairwise(words) if option in options),
        *pictures,
        *re.findall(r"^figure: (.*)$", said, re.MULTILINE),
    ]


def any_content(path: Path) -> bool:
    """Return whether *path* is a file with something in it, or a folder with something in it."""
    return any(path.iterdir()) if path.is_dir() else path.is_file() and path.stat().st_size > 0


def activate(place: Place, script: str) -> None:
    """Do what the activation of a virtual environment does to the commands that follow."""
    folder = (place.folder / script).resolve().parent
    if not (place.folder / script).is_file():
        raise StepError(f"{script} is not there")
    place.environment |= {"VIRTUAL_ENV": str(folder.parent), "PATH": f"{folder}:{place.environment['PATH']}"}


def run(place: Place, words: list[str]) -> tuple[int, str]:
    """Run a program; return its exit code and all that it has printed."""
    try:
        ended = subprocess.run(
            words,
            cwd=place.folder,
            env=place.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LONG_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise StepError(f"has not ended after {LONG_S} s\n{error.output}") from None
    return ended.returncode, ended.stdout


def show(place: Place, words: list[str]) -> None:
    """Start a command that shows a page, fetch the page, and interrupt the command."""
    program = shutil.which(words[0], path=place.environment["PATH"]) or words[0]
    try:
        process = subprocess.Popen(
            [program, *words[1:]],
            cwd=place.folder,
            env=place.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
    except OSError as error:
        raise StepError(str(error)) from None
    with process:
        assert process.stdout is not None
        said = ""
        try:
            for said in process.stdout:
                if said.startswith("http://127.0.0.1:"):
                    break
            else:
                raise StepError(f"exit code {process.wait()}, and no address\n{said}")
            with urlopen(said.strip(), timeout=60) as answer:
                page = answer.read()
            process.send_signal(signal.SIGINT)
            rest, code = process.stdout.read(), process.wait(timeout=60)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise StepError(str(error)) from None
        finally:
            process.kill()
        if code or b"<html" not in page:
            raise StepError(f"exit code {code}, {len(page)} bytes of page\n{rest}")


# ---------------------------------------------------------------- the two places


def environment(home: Path, python: str) -> dict[str, str]:
    """Return the environment of a fresh machine: a new home, and of Python nothing but *python*, called python3."""
    real = subprocess.run(
        [python, "-c", "import sys; print(sys.executable)"], stdout=subprocess.PIPE, text=True, check=True
    )
    (home / "bin").mkdir(parents=True)
    (home / "bin" / "python3").symlink_to(real.stdout.strip())
    kept = {
        name: value for name, value in os.environ.items() if name.startswith(("PIP_", "LANG", "LC_", "SSL_", "TMP"))
    }
    config = Path.home() / ".config" / "pip" / "pip.conf"  # where packages come from is not the README's to say
    if config.is_file():
        kept.setdefault("PIP_CONFIG_FILE", str(config))
    kept.setdefault("PIP_CACHE_DIR", str(Path.home() / ".cache" / "pip"))
    path = f"{home / 'bin'}:/usr/local/bin:/usr/bin:/bin"
    return kept | {"HOME": str(home), "PATH": path, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}


def follow(place: Place, page: Told, everything: bool) -> None:
    """Do all that *page* tells at *place*."""
    print(f"\n{place.name}, in {place.folder}", flush=True)
    for name, text in page.files.items():
        (place.folder / name).write_text(text, encoding="utf-8")
    for step in page.steps:
        do(place, step, page, everything)


def wheel_installed(place: Place, clone: Path) -> None:
    """Build the wheel of *clone* and install it, with the pages' extra, into an environment of its own."""
    here = place.folder.parent
    steps = (
        f"python3 -m venv {here}/venv",
        f". {here}/venv/bin/activate",
        f"pip wheel --quiet --no-deps --wheel-dir {here} {clone}",
        f'pip install --quiet -c {clone}/constraints.txt "$(echo {here}/*.whl)[web]"',
    )
    print(f"\nthe wheel, into {here}/venv", flush=True)
    for step in steps:
        do(Place("", place.folder, place.environment, None, place.failed), step, Told(), True)


def main() -> None:
    """Follow the README in a fresh clone, and then with the wheel elsewhere; exit with 1 if anything fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true", help="also what takes long: full sweeps, make test")
    parser.add_argument("--keep", action="store_true", help="do not delete the folder in the end")
    chosen = parser.parse_args()
    python = os.environ.get("PYTHON") or shutil.which("python3.11") or "python3"
    top = Path(tempfile.mkdtemp(prefix="fresh-"))
    clone, elsewhere = top / "cosim", top / "elsewhere" / "work"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    elsewhere.mkdir(parents=True)
    page = told((clone / "README.md").read_text(encoding="utf-8"))
    places = [
        Place("the checkout", clone, environment(top / "home", python)),
        Place("the wheel", elsewhere, environment(top / "home_elsewhere", python), clone),
    ]
    follow(places[0], page, chosen.all)
    wheel_installed(places[1], clone)
    follow(places[1], page, chosen.all)
    failed = [f"{place.name}: {step}" for place in places for step in place.failed]
    print(f"\n{len(failed)} failed" if failed else "\nall ended as the README says")
    print("\n".join(failed))
    if not chosen.keep:
        shutil.rmtree(top)
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
