"""Documents that people write: YAML read strictly, settings changed by path, and one-line errors that name their place.

An error reads ``depot.yaml: team.body.radius_m: -0.2 is not > 0``: the document, the path in it, the value, what was
expected. A value that came from the command line is named by what stood there: ``--set team.size=0: 0 is not >= 1``.
"""

import difflib
import errno
import re
import stat
import sys
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple, TypeAlias, TypeVar, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from cosim.errors import UserError
from cosim.settings import Settings

Model = TypeVar("Model", bound=Settings)
Place: TypeAlias = tuple[str | int, ...]

SELECTORS = ("kind", "use")
"""Settings that decide which others there are: another value replaces the whole mapping around them."""

MOST_BYTES: Final = 16 * 2**20
"""The size of the largest document that is read."""
MOST_VALUES: Final = 200_000
"""Keys and values in the largest document: it takes the reader ten seconds."""

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
    """YAML's safe loader, which refuses a key that stands twice in a mapping, and what aliases make too large."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._composed = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next node; raise when there have been too many."""
        self._composed += 1
        if self._composed > MOST_VALUES:
            raise _too_large(self.peek_event().start_mark)  # type: ignore[no-untyped-call]
        return super().compose_node(parent, index)

    def construct_document(self, node: yaml.Node) -> Any:
        """Return the value of the document; raise if there is too much of it once its aliases are written out."""
        _weigh(node, {})
        return super().construct_document(node)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Return the value of *node*; raise on what looks like a number, a date or text and is none."""
        try:
            value = super().construct_object(node, deep)
            if isinstance(value, str):
                value.encode()  # half of a surrogate pair is no text
            return value
        except (ValueError, TypeError, AttributeError, LookupError, ArithmeticError) as error:  # all that theirs raise
            what = f"{_short(node.value)} is no {node.tag.rpartition(':')[2]}"
            why = f": {error}" if isinstance(error, ValueError) else ""
            raise yaml.constructor.ConstructorError(None, None, f"{what}{why}", node.start_mark) from None

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


def _weigh(node: yaml.Node, known: dict[int, int | None]) -> int:
    """Return how many keys and values *node* stands for, those that aliases repeat counted again; raise for too many.

    *known* are the weights of nodes that have been met, None for those around this one.
    """
    if id(node) not in known:
        known[id(node)] = None
        inner: list[Any] = [] if isinstance(node, yaml.ScalarNode) else node.value
        parts = [part for item in inner for part in (item if isinstance(item, tuple) else (item,))]
        known[id(node)] = 1 + sum(_weigh(part, known) for part in parts)
    weight = known[id(node)]
    if weight is None:
        raise yaml.constructor.ConstructorError(None, None, "stands within itself", node.start_mark)
    if weight > MOST_VALUES:
        raise _too_large(node.start_mark)
    return weight


def _too_large(mark: yaml.Mark) -> yaml.MarkedYAMLError:
    return yaml.constructor.ConstructorError(None, None, f"holds more than {MOST_VALUES} values", mark)


def is_file(path: Path) -> bool:
    """Return whether *path* names a file; a name that none can have, for it is too long, names none."""
    try:
        return path.is_file()
    except OSError:
        return False


_UNSIZED: Final = 1 << 16
"""Bytes that are read of files of which the system does not tell the size."""


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Return the content of the regular file *path*, of *most* bytes at most; raise UserError for anything else."""
    try:
        state = path.stat()
        if not stat.S_ISREG(state.st_mode):  # to open a pipe would wait for who writes it, and a device may have no end
            raise OSError(errno.EINVAL, "is a directory" if stat.S_ISDIR(state.st_mode) else "is a pipe or a device")
        with path.open("rb") as file:
            content = file.read(min(most, max(state.st_size, _UNSIZED)) + 1)  # it makes room for all that at once
    except (OSError, ValueError) as error:  # one of values: a name with a NUL in it
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise UserError(f"{path}: cannot be read, expected a file: {why.lower()}") from None
    if len(content) > most:
        raise UserError(f"{path}: is larger than {most / 2**20:g} MB, the most that is read")
    return content


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


def assignment(path: str, value: Any) -> str:
    """Return ``path=value`` such as parse_assignment reads."""
    text: str = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=float("inf"))
    return f"{path}={text.partition(chr(10))[0]}"


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


def in_turn(assignments: Iterable[Assignment]) -> list[list[Assignment]]:
    """Return *assignments* in groups to be made one after the other: what a kind is first, then what it has."""
    given = list(assignments)
    groups = [[item for item in given if (item.place[-1] in SELECTORS) is first] for first in (True, False)]
    return [group for group in groups if group]


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

    Raise UserError with the first of its errors and the places of the others.
    *inner* are models at places where *model* leaves it to the document which one it is.
    """
    try:
        return model.model_validate(plain)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    walked = [_walk(model, each["loc"], inner) for each in errors]
    places = [
        (*place, _discriminator(each)) if each["type"].startswith("union_tag") else place
        for each, (place, _) in zip(errors, walked, strict=True)
    ]
    prefix = _prefix(places[0], source, assignments)
    others = [show_place(place) for place in dict.fromkeys(places) if place != places[0]]
    more = f" (and {len(others)} more: {_short(', '.join(others), 120, str)})" if others else ""
    raise UserError(f"{prefix}: {_expectation(errors[0], walked[0][1])}{more}")


def _prefix(place: Place, source: str, assignments: Sequence[Assignment]) -> str:
    for item in assignments:
        if place[: len(item.place)] == item.place:
            inner = show_place(place[len(item.place) :])
            return f"{item.source}: {inner}" if inner else item.source
    made = "".join(f" with {item.source}" for item in assignments)
    return f"{source}{made}: {show_place(place)}" if place else f"{source}{made}"


def _expectation(error: ErrorDetails, models: Sequence[type[BaseModel]]) -> str:
    kind, context, value = error["type"], error.get("ctx", {}), error["input"]
    if kind == "missing":
        return "is missing"
    if kind == "union_tag_not_found":
        return f"is missing, in {_short(value)}"
    if kind == "extra_forbidden":
        return f"{_short(value)} is not expected here: there is no such key{_instead(str(error['loc'][-1]), models)}"
    if kind == "model_type":
        return f"{_short(value)} is not a mapping of settings"
    if kind == "model_attributes_type":  # settings of one of several kinds
        named = value if isinstance(value, str) else "..."
        return f"{_short(value)} is not a mapping of settings, expected a mapping such as {{kind: {named}}}"
    if kind == "value_error":
        text = str(context.get("error", error["msg"]))
        return text if isinstance(value, Mapping | BaseModel) else f"{_short(value)} {text}"
    if kind in _COMPARISONS:
        key, sentence = _COMPARISONS[kind]
        chosen = kind == "union_tag_invalid" and isinstance(value, Mapping)
        shown = value.get(_discriminator(error)) if chosen else value
        limit = context[key]
        return f"{_short(shown)} {sentence.format(f'{limit:g}' if isinstance(limit, float) else limit)}"
    if kind in ("bool_parsing", "bool_type"):
        return f"{_short(value)} is not true or false"
    message = error["msg"].removeprefix("Input should be ").split(", unable to")[0]
    return f"{_short(value)} is not {message}" if message != error["msg"] else f"{_short(value)}: {message.lower()}"


def _instead(name: str, models: Sequence[type[BaseModel]]) -> str:
    """Return the end of a sentence that says where a setting called *name*, which *models* have not, may belong."""
    kinds = sorted({kind for each in models if issubclass(each, Settings) for kind in each.kinds_with(name)})
    if kinds:
        *others, last = kinds
        return f", but {', '.join(others)} and {last} have one" if others else f", but {last} has one"
    return nearest(name, [field for each in models for field in each.model_fields])


def _discriminator(error: ErrorDetails) -> str:
    """Return the name of the setting that says of which kind the settings are that *error* is about."""
    return str(error["ctx"]["discriminator"]).strip("'")


def _short(value: Any, most: int = 60, show: Callable[[Any], str] = repr) -> str:
    text = show(value)
    return text if len(text) <= most else text[: most - 3] + "..."


# ---------------------------------------------------------------- places in a model


def _walk(
    model: type[BaseModel], loc: Place, inner: Mapping[Place, type[BaseModel]]
) -> tuple[Place, list[type[BaseModel]]]:
    """Return *loc* without what pydantic puts into it for unions, and the models in which its end is looked for."""
    place: list[str | int] = []
    around: list[type[BaseModel]] = []
    here: list[Any] = [model]
    module = model.__module__
    for step in loc:
        meant = [each for each in here if step in _labels(each)]
        one_of_several = len(here) > 1 and (meant or "[" in str(step))
        if one_of_several or step == "[key]":
            here = meant or here
            continue
        place.append(step)
        models = [each for each in here if _is_model(each)]
        if isinstance(step, str):
            around = models
        module = models[0].__module__ if models else module
        found = inner.get(tuple(place))
        here = [found] if found else [type_ for each in here for type_ in _below(each, step, module)]
    return tuple(place), around


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _labels(annotation: Any) -> set[Any]:
    """Return what pydantic may call a type where it is one of several."""
    fields = annotation.model_fields.values() if _is_model(annotation) else ()
    tags = {field.default for field in fields if get_origin(field.annotation) is Literal}
    return tags | {getattr(annotation, "__name__", None)}


def _below(annotation: Any, step: str | int, module: str) -> Iterator[Any]:
    """Yield the types of what may stand at *step* in a value of the type *annotation*, as far as they are known."""
    parts = [part for part in get_args(annotation) if part is not Ellipsis]
    if _is_model(annotation):
        if step in annotation.model_fields:
            yield from _types(annotation.model_fields[step].annotation, module)
    elif parts and isinstance(get_origin(annotation), type) and issubclass(get_origin(annotation), Mapping):
        yield from _types(parts[-1], module)
    elif parts and isinstance(step, int):
        yield from _types(parts[min(step, len(parts) - 1)], module)


def _types(annotation: Any, module: str) -> Iterator[Any]:
    """Yield the types of which *annotation*, written in *module*, allows one."""
    if isinstance(annotation, str):
        annotation = getattr(sys.modules[module], annotation)
    if get_origin(annotation) is Annotated:
        yield from _types(get_args(annotation)[0], module)
    elif get_origin(annotation) in (Union, types.UnionType):
        for part in get_args(annotation):
            yield from _types(part, module)
    elif annotation is not types.NoneType:
        yield annotation
