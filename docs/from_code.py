"""Pages of the handbook that the code writes: the command line from click, the settings from their models.

In place of the lines from ``<!-- from the code: NAME -->`` to ``<!-- to here -->`` of a page, the built site has what
``PAGES[NAME]`` returns. Nothing of it is kept in the repository, so that it cannot be out of date.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from inspect import cleandoc, get_annotations
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import click
import yaml
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined
from sphinx.pycode import ModuleAnalyzer

from cosim.channels.kinds import ChannelSettings, channel_kinds, channel_spec
from cosim.cli import commands
from cosim.experiment import ExperimentSettings
from cosim.scenario import Scenario, dump, protocol_names, protocol_spec
from cosim.settings import Settings

MARK = re.compile(r"^<!-- from the code: (\w+) -->\n.*?^<!-- to here -->$", re.MULTILINE | re.DOTALL)


def fill(app: object, name: str, source: list[str]) -> None:
    """Put what the code writes into the text of a page, *source*, before Sphinx reads it."""
    source[0] = MARK.sub(lambda mark: PAGES[mark.group(1)](), source[0])


def outdated(app: object, env: Any, added: set[str], changed: set[str], removed: set[str]) -> list[str]:
    """Return the pages that are to be read again though their own text is as it was."""
    return [name for name in env.found_docs if MARK.search(env.doc2path(name).read_text(encoding="utf-8"))]


# ---------------------------------------------------------------- the command line


def command_line() -> str:
    """Return a section for each command: what it does, its usage, its options."""
    context = click.Context(commands, info_name="cosim")
    sections = []
    for name in commands.list_commands(context):
        command = commands.get_command(context, name)
        if command is not None:
            sections += list(_command(name, command, context))
    return "\n".join(sections)


def _command(name: str, command: click.Command, parent: click.Context) -> Iterator[str]:
    context = click.Context(command, info_name=name, parent=parent)
    level = context.command_path.count(" ") + 1
    yield f"{'#' * level} `{context.command_path}`\n"
    yield f"```text\n{context.command_path} {' '.join(command.collect_usage_pieces(context))}\n```\n"
    yield f"{cleandoc(command.help or command.short_help or '')}\n"
    records = [
        option.get_help_record(context) for option in command.get_params(context) if isinstance(option, click.Option)
    ]
    yield _grid(("option", "meaning"), ((f"`{first}`", text) for first, text in filter(None, records)))
    if isinstance(command, click.Group):
        for inner in command.list_commands(context):
            found = command.get_command(context, inner)
            if found is not None:
                yield from _command(inner, found, context)


# ---------------------------------------------------------------- settings


def scenario() -> str:
    """Return a section for each model that a scenario consists of, but for those of channels and protocols."""
    return _sections([Scenario], ())


def experiment() -> str:
    """Return a section for each model that a sweep.yaml consists of."""
    return _sections([ExperimentSettings], _models([Scenario]))


def channels() -> str:
    """Return a section for each installed channel, and for the models that its settings consist of."""
    roots = {name: channel_spec(name).settings for name in channel_kinds()}
    return _by_name(roots)


def protocols() -> str:
    """Return a section for each installed protocol, and for the models that its parameters consist of."""
    roots = {name: protocol_spec(name).parameters for name in protocol_names()}
    return _by_name(roots)


def _by_name(roots: dict[str, type[Settings]]) -> str:
    shared = [model for model in _models(roots.values()) if model not in roots.values()]
    parts = [_section(f"## {name}", model) for name, model in roots.items()]
    return "\n".join([*parts, "## Parts\n", *(_section(f"### {_title(model)}", model) for model in shared)])


def _sections(roots: Iterable[type[Settings]], known: Iterable[type[Settings]]) -> str:
    return "\n".join(_section(f"## {_title(model)}", model) for model in _models(roots) if model not in known)


def _section(heading: str, model: type[Settings]) -> str:
    return f"{heading}\n\n{_text(model)}\n\n{_table(model)}"


def _title(model: type[Settings]) -> str:
    """Return what the model is called on its page: with its package, where another of this name is in it."""
    package = model.__module__.split(".")[1]
    return f"{model.__name__} of {package}" if model.__name__ in TWICE else model.__name__


def _text(model: type[Settings]) -> str:
    return " ".join((model.__doc__ or "").partition("\n\n")[0].split())


def _models(roots: Iterable[type[Settings]]) -> list[type[Settings]]:
    """Return *roots* and every model that one of their fields can be, each once, in the order of the fields."""
    found: dict[type[Settings], None] = {}
    waiting = list(roots)
    while waiting:
        model = waiting.pop(0)
        if model not in found:
            found[model] = None
            waiting += [part for field in model.model_fields.values() for part in _parts(field.annotation)]
    return [model for model in found if model.model_fields and model is not ChannelSettings]


def _parts(annotation: Any) -> Iterator[type[Settings]]:
    if isinstance(annotation, type) and issubclass(annotation, Settings):
        yield annotation
    for inner in get_args(annotation):
        yield from _parts(inner)


def _table(model: type[Settings]) -> str:
    rows = []
    for name, field in model.model_fields.items():
        unit, meaning = _meaning(model, name, field)
        rows.append((f"`{name}`", _type(field), _default(field), unit, meaning))
    return _grid(("key", "type", "default", "unit", "meaning"), rows)


# ---------------------------------------------------------------- one field

WORDS = {float: "number", int: "integer", str: "text", bool: "true or false", NoneType: "null", Any: "anything"}
MOST_NAMED = 4
"""Models that the type of a field names one by one."""
BOUNDS = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
UNIT = re.compile(
    r"(?:µ|m|k|M)?(?:s|m|J|W|b/s|Hz|dB|dBm|dBi|rad|deg|degrees|slots|ticks|octets|bytes|cells)(?:/\w+\^?\d?|\^2)?|1/s|1/m"
)
SUFFIXES = {
    "_s": "s", "_m": "m", "_mps": "m/s", "_dbm": "dBm", "_db": "dB", "_slots": "slots", "_ticks": "ticks",
    "_deg": "degrees", "_rad": "rad", "_per_s": "1/s", "_per_m": "1/m", "_radps": "rad/s", "_mps2": "m/s²",
}  # fmt: skip


def _type(field: FieldInfo) -> str:
    bounds = [
        f"{sign} {getattr(limit, name):g}"
        for limit in field.metadata
        for name, sign in BOUNDS.items()
        if getattr(limit, name, None) is not None
    ]
    return ", ".join([_kind(field.annotation), *bounds])


def _kind(annotation: Any) -> str:
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _kind(inner[0])
    if origin in (Union, UnionType) and len(list(_parts(annotation))) > MOST_NAMED:
        return f"one of {len(list(_parts(annotation)))} kinds, below"
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(map(_kind, inner)))
    if origin is Literal:
        return ", ".join(f"`{value}`" for value in inner)
    if origin is tuple:
        return f"list of {_kind(inner[0])}" if inner[-1] is ... else f"[{', '.join(map(_kind, inner))}]"
    if origin in (list, frozenset, set):
        return f"list of {_kind(inner[0])}"
    if isinstance(origin, type):  # a dict or a Mapping
        return f"mapping of {_kind(inner[0])} to {_kind(inner[1])}"
    if annotation is ChannelSettings:
        return "[settings of a channel](channels.md)"
    if annotation is Settings:
        return "[settings of a protocol](protocols.md)"
    if isinstance(annotation, type) and issubclass(annotation, Settings) and annotation.model_fields:
        return f"[{annotation.__name__}](#{_title(annotation).lower().replace(' ', '-')})"
    return WORDS.get(annotation, getattr(annotation, "__name__", str(annotation)))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.default if field.default is not PydanticUndefined else field.default_factory()  # type: ignore[call-arg, misc]
    if isinstance(value, BaseModel):
        return "its own"
    plain = value if not isinstance(value, tuple) else [dump(v) if isinstance(v, Settings) else v for v in value]
    flow = yaml.safe_dump(plain, default_flow_style=True, width=10**9).removesuffix("...\n").strip()
    return f"`{flow}`"


def _meaning(model: type[Settings], name: str, field: FieldInfo) -> tuple[str, str]:
    text = field.description or _remark(model, name)
    if not text and name == "kind":
        return "", "names these settings" if get_origin(field.annotation) is Literal else "which one"
    if not text:
        return "", next(
            (f"{_text(part)[0].lower()}{_text(part)[1:].rstrip('.')}" for part in _parts(field.annotation)), ""
        )
    first, comma, rest = text.partition(", ")
    if comma and UNIT.fullmatch(first):
        return first, rest
    suffix = next((suffix for suffix in sorted(SUFFIXES, key=len, reverse=True) if name.endswith(suffix)), "")
    return SUFFIXES.get(suffix, ""), text


def _remark(model: type[Settings], name: str) -> str:
    """Return the docstring below the field, of the class or the base that declares it."""
    for base in model.__mro__:
        if name in get_annotations(base):
            lines = ModuleAnalyzer.for_module(base.__module__).find_attr_docs().get((base.__qualname__, name), [])
            text = " ".join(" ".join(lines).split()).rstrip(".")
            return f"{text[:1].lower()}{text[1:]}"
    return ""


def _grid(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "".join(
        f"| {' | '.join(cell.replace('|', '/').replace(chr(10), ' ') for cell in line)} |\n" for line in lines
    )


NAMES = Counter(model.__name__ for model in _models(protocol_spec(name).parameters for name in protocol_names()))
TWICE = {name for name, count in NAMES.items() if count > 1}
"""Names that models of several protocols have."""
PAGES: dict[str, Callable[[], str]] = {
    "command_line": command_line,
    "scenario": scenario,
    "experiment": experiment,
    "channels": channels,
    "protocols": protocols,
}
