"""An experiment's ``figures.py``: loaded from its folder, and called.

It is a user's code and may fail in any way. Whatever is wrong with it becomes a UserError of one line that names the
file, the line and the cause.
"""

import importlib.util
import re
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np
import pandas as pd

from cosim.errors import UserError

MOST_LETTERS = 80
"""Most characters of a user's text that an error quotes."""
_MARKED: Final = re.compile(r"(``|\*)(\w+)\1")
"""A name in a docstring."""


def load_figures(folder: Path | None) -> ModuleType | None:
    """Return the figures.py in *folder* as a module, None if there is none; raise UserError if it cannot be loaded."""
    path = folder / "figures.py" if folder else None
    if path is None or not path.is_file():
        return None
    spec = importlib.util.spec_from_file_location("figures", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with _blamed(str(path)):
        spec.loader.exec_module(module)
    return module


def call(figures: ModuleType | None, name: str, *arguments: Any) -> Any:
    """Return the answer of the function *name* in *figures*; raise UserError if it fails, or answers something else."""
    path = getattr(figures, "__file__", None) or "figures.py"
    with _blamed(path, f"{name}: "):
        answer = getattr(figures, name)(*arguments)
    if name == "tables":
        expected = "a dict of titles and tables"
        right = isinstance(answer, dict) and all(isinstance(table, pd.DataFrame) for table in answer.values())
    elif name == "draw":
        expected = "a list of paths"
        right = isinstance(answer, list) and all(isinstance(path, Path) for path in answer)
    else:
        expected = "(ours, whether the claim holds or None)"
        right = isinstance(answer, tuple) and len(answer) == 2 and isinstance(answer[1], bool | np.bool_ | None)
    if not right:
        raise UserError(f"{path}: {name}: answers {shortened(repr(answer))}, expected {expected}")
    return answer


def question(figures: ModuleType | None, name: str) -> str:
    """Return what the function *name* in *figures* answers: the first sentence of its docstring, without the verb.

    Its reader does not have the code: the name of a constant or of an argument that is bound gives way to its value,
    if that is a text or a number. Without a docstring it is nothing.
    """
    found = getattr(figures, name)
    values: dict[str, object] = {}
    if isinstance(found, partial):
        names = getattr(getattr(found.func, "__code__", None), "co_varnames", ())  # those of arguments are the first
        values = dict(zip(names, found.args, strict=False)) | found.keywords
        found = found.func
    values = getattr(found, "__globals__", {}) | values
    text = " ".join((found.__doc__ or "").split("\n\n")[0].split()).rstrip(".")
    text = text.removeprefix("Return ").removeprefix("Answer ")
    return _MARKED.sub(lambda marked: _valued(marked[2], values), text)


def _valued(name: str, values: Mapping[str, object]) -> str:
    value = values.get(name)
    return f"{value:g}" if isinstance(value, int | float) else value if isinstance(value, str) else name


@contextmanager
def _blamed(path: str, name: str = "") -> Iterator[None]:
    """Raise a UserError with the line in the file *path* for whatever fails; its cause has the whole traceback."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:  # the user's own code ran, which may raise anything; raised again with its line
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
        line = error.lineno if isinstance(error, SyntaxError) and error.filename == path else (lines or [None])[-1]
        where = f"{path}: line {line}" if line else path
        raise UserError(f"{where}: {name}{type(error).__name__}: {shortened(error)}") from error


def shortened(text: object) -> str:
    """Return *text* in one line of at most ``MOST_LETTERS`` characters."""
    line = " ".join(str(text).split())
    return line if len(line) <= MOST_LETTERS else f"{line[: MOST_LETTERS - 3]}..."
