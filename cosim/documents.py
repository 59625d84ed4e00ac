"""Documents that people write: YAML read strictly, settings changed by path, and one-line errors that name their place.

An error reads ``depot.yaml: team.body.radius_m: -0.2 is not > 0``: the document, the path in it, the value, what was
expected. A value that came from the command line is named by what stood there: ``--set team.size=0: 0 is not >= 1``.
"""

import difflib
import re
import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias, TypeVar, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from cosim.errors import UserError
from cosim.settings import Settings

Model = TypeVar("Model", bound=Settings)
Place: TypeAlias = tuple[str | int, ...]

SELECTORS = ("kind", "use")
"""Settings that decide which others there are: another value replaces the whole mapping around them."""

_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")
_COMPARISONS = {
    "greater_than": ("gt", "is not > {}"),
    "greater_than_equal": ("ge", "is not >= {}"),
    "less_than": ("lt", "is not < {}"),
    "less_than_equal": ("le", "is not <= {}"),
    "literal_error": ("expected", "is not {}"),
    "union_tag_invalid": ("expected_tags", "is not one of {}"),
}


class Assignment(NamedTuple):
    """A setting that is given beside the document: by ``--set path=value``, or by an axis of a sweep."""

    place: Place
    value: Any
    source: str
    """Where it stands, for errors."""


# ---------------------------------------------------------------- reading


class _StrictLoader(yaml.SafeLoader):
    """YAML's safe loader, which refuses a key that stands twice in a mapping."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Return the value of *node*; raise on what looks like a number or a date and is none."""
        try:
            return super().construct_object(node, deep)
        except (ValueError, TypeError) as error:
            raise yaml.constructor.ConstructorError(None, None, f"is no value: {error}", node.start_mark) from None

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping of *node*; raise on a key that a reader would believe and the program ignore."""
        seen: set[str] = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key.value!r} stands twice", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def read_bytes(path: Path) -> bytes:
    """Return the content of the file *path*; raise UserError if there is none."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise UserError(f"{path}: cannot be read, expected a file: {(error.strerror or str(error)).lower()}") from None


def read_text(path: Path) -> str:
    """Return the text of the file *path*, in UTF-8; raise UserError if there is none."""
    try:
        return read_bytes(path).decode()
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: byte {error.start} is not UTF-8 text") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in the YAML file *path*; raise UserError naming line and column where it breaks."""
    plain = parse_yaml(read_text(path), str(path))
    if not isinstance(plain, dict):
        found = "nothing" if plain is None else _short(plain)
        raise UserError(f"{path}: holds {found}, expected a mapping of settings")
    return plain


def parse_yaml(text: str, source: str) -> Any:
    """Return the value of the YAML *text*, which comes from *source*."""
    try:
        return yaml.load(text, _StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise UserError(f"{source}: {where}{error.problem or error.context}") from None
    except (yaml.YAMLError, RecursionError, TypeError) as error:  # one of types: a tag that does not fit its node
        raise UserError(f"{source}: is not YAML: {' '.join(str(error).split())}") from None


def parse_assignment(text: str) -> Assignment:
    """Return ``path=value`` as an assignment, the value read as YAML."""
    path, equals, value = text.partition("=")
    place = parse_place(path.strip())
    if not equals or not place:
        raise UserError(f"--set {text}: expected path=value, such as team.size=3")
    return Assignment(place, parse_yaml(value, f"--set {text}"), f"--set {text}")


def parse_place(path: str) -> Place:
    """Return the steps of a path such as ``team.starts[2]``; nothing if it is not one."""
    place = tuple(step[1] if step[1] else int(step[2]) for step in _STEP.finditer(path))
    return place if place and show_place(place) == path else ()


def show_place(place: Iterable[str | int]) -> str:
    """Return *place* as people write it: ``team.starts[2]``."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in place).lstrip(".")


# ---------------------------------------------------------------- changing


def assign(plain: dict[str, Any], assignments: Iterable[Assignment]) -> dict[str, Any]:
    """Return a copy of *plain* (a dump, in which every setting stands) with the *assignments* made, in order.

    Raise UserError for a path that is not there, with the names that are.
    """
    result: dict[str, Any] = _copy(plain)
    for item in assignments:
        *outer, last = item.place
        target: Any = result
        for depth, step in enumerate(outer):
            target = _entered(target, step, item, depth)
        if last in SELECTORS and isinstance(target, dict) and target.get(str(last), item.value) != item.value:
            target.clear()  # the settings of another kind
        else:
            _entered(target, last, item, len(outer))
        target[last] = _copy(item.value)
    return result


def _entered(target: Any, step: str | int, item: Assignment, depth: int) -> Any:
    if isinstance(target, dict) and step in target:
        return target[step]
    if isinstance(target, list) and isinstance(step, int) and step < len(target):
        return target[step]
    place = show_place(item.place[: depth + 1])
    if isinstance(target, dict):
        raise UserError(f"{item.source}: there is no {place}{nearest(str(step), target)}")
    raise UserError(f"{item.source}: there is no {place}: {show_place(item.place[:depth])} is {_short(target)}")


def _copy(plain: Any) -> Any:
    if isinstance(plain, dict):
        return {key: _copy(value) for key, value in plain.items()}
    return [_copy(value) for value in plain] if isinstance(plain, list) else plain


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the end of a sentence that names what *name* may have been meant to be."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.6)
    if close:
        return f", did you mean {' or '.join(close)}?"
    return f", expected one of {', '.join(names)}" if names else ", nothing is expected there"


# ---------------------------------------------------------------- validating


def validated(
    model: type[Model],
    plain: Any,
    source: str,
    assignments: Sequence[Assignment] = (),
    inner: Mapping[Place, type[BaseModel]] = types.MappingProxyType({}),
) -> Model:
    """Return *plain*, read from *source* and changed by *assignments*, as *model*.

    Raise UserError with the first of its errors and the number of the others.
    *inner* are models at places where *model* leaves it to the document which one it is.
    """
    try:
        return model.model_validate(plain)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    first = errors[0]
    place, names = _walk(model, first["loc"], inner)
    if first["type"].startswith("union_tag"):
        place = (*place, "kind")
    prefix = _prefix(place, source, assignments)
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    raise UserError(f"{prefix}: {_expectation(first, names)}{more}")


def _prefix(place: Place, source: str, assignments: Sequence[Assignment]) -> str:
    for item in assignments:
        if place[: len(item.place)] == item.place:
            inner = show_place(place[len(item.place) :])
            return f"{item.source}: {inner}" if inner else item.source
    made = "".join(f" with {item.source}" for item in assignments)
    return f"{source}{made}: {show_place(place)}" if place else f"{source}{made}"


def _expectation(error: ErrorDetails, names: Iterable[str]) -> str:
    kind, context, value = error["type"], error.get("ctx", {}), error["input"]
    if kind == "missing":
        return "is missing"
    if kind == "union_tag_not_found":
        return f"is missing, in {_short(value)}"
    if kind == "extra_forbidden":
        return f"{_short(value)} is not expected here: there is no such key{nearest(str(error['loc'][-1]), names)}"
    if kind == "model_type":
        return f"{_short(value)} is not a mapping of settings"
    if kind == "model_attributes_type":  # settings of one of several kinds
        named = value if isinstance(value, str) else "..."
        return f"{_short(value)} is not a mapping of settings, expected a mapping such as {{kind: {named}}}"
    if kind == "value_error":
        text = str(context.get("error", error["msg"]))
        return f"{_short(value)} {text}"
    if kind in _COMPARISONS:
        key, sentence = _COMPARISONS[kind]
        shown = value.get("kind") if kind == "union_tag_invalid" and isinstance(value, Mapping) else value
        limit = context[key]
        return f"{_short(shown)} {sentence.format(f'{limit:g}' if isinstance(limit, float) else limit)}"
    message = error["msg"].removeprefix("Input should be ")
    return f"{_short(value)} is not {message}" if message != error["msg"] else f"{_short(value)}: {message.lower()}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


# ---------------------------------------------------------------- places in a model


def _walk(model: type[BaseModel], loc: Place, inner: Mapping[Place, type[BaseModel]]) -> tuple[Place, list[str]]:
    """Return *loc* without the tags that pydantic puts into it for unions, and the names that exist beside its end."""
    place: list[str | int] = []
    names: list[str] = []
    candidates: list[type[BaseModel]] = [model]
    for step in loc:
        tagged = [each for each in candidates if _tag(each) == step]
        if len(candidates) > 1 and tagged:
            candidates = tagged
            continue
        place.append(step)
        if isinstance(step, int):  # an item of a list: what it may be stands already among the candidates
            continue
        names = [name for each in candidates for name in each.model_fields]
        fields = [each.model_fields[step] for each in candidates if step in each.model_fields]
        here = inner.get(tuple(place))
        candidates = [here] if here else [found for field in fields for found in _models(field.annotation)]
    return tuple(place), names


def _tag(model: type[BaseModel]) -> Any:
    field = model.model_fields.get("kind")
    return field.default if field else None


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if get_origin(annotation) in (Union, types.UnionType, tuple, Annotated):
        for part in get_args(annotation):
            yield from _models(part)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
