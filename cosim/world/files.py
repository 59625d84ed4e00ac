"""Reading what a user wrote, with errors that name file, place, value and what was expected, in one line."""

from pathlib import Path
from typing import Any, Final, TypeVar

import yaml
from pydantic import ValidationError

from cosim.errors import UserError
from cosim.settings import Settings

Model = TypeVar("Model", bound=Settings)
LONGEST: Final = 60
"""How many characters of a wrong value are shown."""


def read_bytes(path: Path) -> bytes:
    """Return the content of the file *path*; raise UserError where there is none to read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise UserError(f"{path}: cannot be read, expected a file: {error.strerror}") from None


def read_text(path: Path) -> str:
    """Return the text of the file *path*, in UTF-8; raise UserError where there is none."""
    try:
        return read_bytes(path).decode()
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: byte {error.start}: {error.object[error.start]:#04x} is not UTF-8 text") from None


def read_mapping(path: Path) -> dict[str, Any]:
    """Return what the YAML file *path* holds; raise UserError unless it is a mapping."""
    try:
        content = yaml.safe_load(read_text(path))
    except yaml.MarkedYAMLError as error:
        place = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise UserError(f"{path}: {place}not YAML: {error.problem}") from None
    except yaml.YAMLError as error:
        raise UserError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(content, dict):
        raise UserError(f"{path}: {type(content).__name__} found, expected a mapping of keys to values")
    return content


def checked(model: type[Model], content: dict[str, Any], path: Path) -> Model:
    """Return *content* of the file *path* as *model*; raise UserError for the first thing that is wrong with it."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise UserError(f"{path}: {_told(error)}") from None


def _told(error: ValidationError) -> str:
    """Say where the first fault is, which value it is about and what was expected."""
    first = error.errors(include_url=False)[0]
    expected = first["msg"].removeprefix("Value error, ")
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]).lstrip(".")
    if not place:
        return expected
    expected = expected[0].lower() + expected[1:]
    value = repr(first["input"])
    value = value if len(value) <= LONGEST else f"{value[:LONGEST]}..."
    return f"{place}: {expected}" if first["type"] == "missing" else f"{place}: {value}: {expected}"
