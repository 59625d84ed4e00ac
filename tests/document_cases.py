"""Documents that people have spoilt: every document of the repository, with one to three seeded mutations.

A document is the file that is read and those that it names. Half of the mutations are of its structure (what YAML makes
of it), half of its text. ``python -m tests.document_cases SEED FOLDER`` writes the files of a case.
"""

import io
import random
import re
import sys
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from PIL import Image

from tests.checkout import ROOT

PLAIN = {"duration_s": 5, "team": {"size": 2}, "protocol": {"use": "monitoring", "parameters": {"period_s": 0.2}}}
FLOOR = {"map": "walls", "bounds_m": [0, 0, 12, 10]}


_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_Dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class Document(NamedTuple):
    """Files by their names; one of them is to be spoilt, and *entry* is what the user names."""

    name: str
    entry: str
    spoilt: str
    files: dict[str, bytes]


# ---------------------------------------------------------------- what there is


@cache
def sources() -> dict[str, list[Callable[[], Document]]]:
    """Return what makes each document, by its kind: most of them are not asked for."""
    experiments = [path for path in sorted(ROOT.glob("experiments/*/*.yaml")) if path.parent.name != "floors"]
    sweeps = [path for path in experiments if path.name != "playbook.yaml"]
    played = sorted({*experiments} - {*sweeps}) + sorted(ROOT.glob("examples/*.yaml"))
    plays = [
        *sorted(ROOT.glob("protocols/deployment/planning/plays/*.yaml")),
        ROOT / "tests/protocols/deployment/soak_plays.yaml",
    ]
    inner = [path for path in sweeps if "scenario:" in path.read_text(encoding="utf-8")]
    return {
        "scenario": [partial(_scenario, *each) for each in [*_blocks(), *_small()]]
        + [partial(_file, path) for path in played],
        "arm": [partial(_arm, path) for path in inner],
        "sweep": [partial(_file, path) for path in sweeps],
        "floor": [partial(_floor, path) for path in sorted(ROOT.glob("experiments/floors/*.yaml"))],
        "play": [partial(_play, path) for path in plays],
        "map": [
            partial(_map, name, image, spoilt) for name, image in _images().items() for spoilt in ("map.yaml", name)
        ]
        + [_movingai] * 3,
    }


def _yaml(plain: Any) -> bytes:
    return yaml.dump(plain, Dumper=_Dumper, sort_keys=False).encode()


def _read(path: Path) -> Any:
    """Return the content of *path*, with the files that it names made absolute."""

    def resolved(plain: Any) -> Any:
        if isinstance(plain, dict):
            return {key: resolved(value) for key, value in plain.items()}
        if isinstance(plain, list):
            return [resolved(value) for value in plain]
        if isinstance(plain, str) and plain.endswith((".yaml", ".map")):
            return next((str(base / plain) for base in (path.parent, ROOT) if (base / plain).is_file()), plain)
        return plain

    return resolved(yaml.load(path.read_text(encoding="utf-8"), _Loader))


def _scenario(name: str, plain: Any) -> Document:
    return Document(name, "scenario.yaml", "scenario.yaml", {"scenario.yaml": _yaml(plain)})


def _file(path: Path) -> Document:
    return _scenario(str(path.relative_to(ROOT)), _read(path))


def _arm(path: Path) -> Document:
    """Return the scenario that a sweep.yaml begins with."""
    plain = _read(path)
    inner = plain.get("scenario") or plain.get("parameters", {}).get("scenario")
    return _scenario(str(path.relative_to(ROOT)), inner if isinstance(inner, dict) else plain)


def _blocks() -> Iterator[tuple[str, Any]]:
    """Yield the examples of README and docs, those that are a part of a scenario completed."""
    for page in ("README.md", "docs/guides/radios.md", "docs/guides/tasks.md", "docs/faults.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        start = r"(?:# [\w.]+\n)?(?:name|channel|protocol|duration_s):"
        read = [yaml.load(found, _Loader) for found in re.findall(rf"```yaml\n({start}.*?)```", text, re.DOTALL)]
        whole = next(block for block in read if "duration_s" in block)
        for number, block in enumerate(read):
            yield f"{page}, block {number}", {**whole, **block}


def _small() -> Iterator[tuple[str, Any]]:
    for kind in ("ideal", "optical", "bluetooth", "adhoc"):
        yield kind, PLAIN | {"floorplan": FLOOR, "channel": {"kind": kind}}


def _floor(path: Path) -> Document:
    files = {"scenario.yaml": _yaml(PLAIN | {"floorplan": {"map": "floor.yaml"}}), "floor.yaml": _yaml(_read(path))}
    return Document(path.name, "scenario.yaml", "floor.yaml", files)


def _play(path: Path) -> Document:
    play = _read(path)
    library = play if "plays" in play and "tasks" not in play else {"plays": {path.stem: play}}
    call = {"at_s": 0, "call": {"play": next(iter(library["plays"])), "places": [[9, 2], [9, 5]]}}
    protocol = {"use": "deployment", "parameters": {"library": "library.yaml", "calls": [call]}}
    team = {"size": 3, "body": {"drive": "differential"}, "senses": {"beams": 36, "beam_range_m": 5}}
    scenario = PLAIN | {"floorplan": FLOOR, "protocol": protocol, "team": team}
    files = {"scenario.yaml": _yaml(scenario), "library.yaml": _yaml(library)}
    return Document(path.name, "scenario.yaml", "library.yaml", files)


CELLS = [[0 if x in (0, 23) or y in (0, 19) or (x == 12 and y < 9) else 254 for x in range(24)] for y in range(20)]
"""A drawn map, 24 x 20 cells: two rooms."""


@cache
def _images() -> dict[str, bytes]:
    picture = Image.frombytes("L", (24, 20), bytes(shade for row in CELLS for shade in row))
    images = {"map.pgm": b"P5\n# drawn\n24 20\n255\n" + picture.tobytes()}
    images["plain.pgm"] = b"P2 24 20 255\n" + b"\n".join(b" ".join(b"%d" % shade for shade in row) for row in CELLS)
    for name, mode in (("grey.png", "L"), ("colour.png", "RGBA"), ("palette.png", "P")):
        content = io.BytesIO()
        picture.convert(mode).save(content, "png")
        images[name] = content.getvalue()
    return images


def _map(name: str, image: bytes, spoilt: str) -> Document:
    keys = {"image": name, "resolution": 0.5, "origin": [-1.0, -2.0, 0.1], "negate": 0, "mode": "trinary"}
    keys |= {"occupied_thresh": 0.65, "free_thresh": 0.196}
    scenario = _yaml(PLAIN | {"floorplan": {"map": "map.yaml"}})
    files = {"scenario.yaml": scenario, "map.yaml": _yaml(keys), name: image}
    return Document(f"ROS map, {name}", "scenario.yaml", spoilt, files)


def _movingai() -> Document:
    rows = "\n".join("".join("@" if shade == 0 else "." for shade in row) for row in CELLS)
    scenario = _yaml(PLAIN | {"floorplan": {"map": "a.map", "resolution_m": 0.5}})
    files = {"scenario.yaml": scenario, "a.map": f"type octile\nheight 20\nwidth 24\nmap\n{rows}\n".encode()}
    return Document("MovingAI map", "scenario.yaml", "a.map", files)


# ---------------------------------------------------------------- mutations of what YAML makes of it

NUMBERS = (
    0,
    -1,
    1,
    2,
    3,
    0.5,
    -0.0,
    1e-300,
    5e-324,
    1e-9,
    1e-3,
    1e3,
    1e5,
    1e6,
    1e9,
    1e12,
    1e18,
    1e19,
    1e100,
    1e200,
    1e300,
)
NUMBERS += (
    -1e9,
    -1e308,
    1e308,
    float("inf"),
    float("-inf"),
    float("nan"),
    255,
    256,
    65536,
    2**31,
    2**32,
    2**63,
    10**30,
)
TEXTS = (
    "",
    " ",
    "x",
    "0",
    "1e5",
    "yes",
    "~",
    "²",
    "\u202eabc",
    "\U0001f916",
    "a\x00b",
    "a\nb",
    "../x",
    "/dev/null",
    ".",
    "x" * 5000,
)
TEXTS += (
    "ideal",
    "walls",
    "office",
    "bluetooth",
    "monitoring",
    "module:name",
    "os:system",
    "[1, 2",
    "é" * 300,
    "{}",
    "*",
    "a.b[0]",
)


def _others(choice: random.Random) -> Any:
    """Return a value of any type."""
    kinds: list[Callable[[], Any]] = [
        lambda: choice.choice(NUMBERS),
        lambda: choice.choice(TEXTS),
        lambda: choice.choice((None, True, False, [], {}, [[]], [{}], {"": None}, {1: 2})),
        lambda: [choice.choice(NUMBERS) for _ in range(choice.choice((1, 2, 3, 4, 300)))],
        lambda: {choice.choice(TEXTS): choice.choice(NUMBERS)},
        lambda: _nested(choice.choice((3, 30, 300))),
    ]
    return choice.choice(kinds)()


def _nested(depth: int) -> Any:
    inner: Any = 1
    for _ in range(depth):
        inner = [inner]
    return inner


def _bomb(levels: int) -> Any:
    """Return lists of which each stands nine times in the next."""
    inner: Any = ["x"] * 9
    for _ in range(levels):
        inner = [inner] * 9
    return inner


def _places(plain: Any) -> Iterator[tuple[Any, Any]]:
    """Yield (container, key) of all that is inside of *plain*; a container that stands at several places only once."""
    waiting, seen = [plain], {id(plain)}
    while waiting:
        container = waiting.pop()
        for key in list(container) if isinstance(container, dict) else range(len(container)):
            yield container, key
            inner = container[key]
            if isinstance(inner, dict | list) and id(inner) not in seen:
                seen.add(id(inner))
                waiting.append(inner)


def _spoil_structure(plain: Any, choice: random.Random) -> None:
    """Mutate *plain* at one place."""
    places = list(_places(plain))
    if not places:
        return
    inside, key = choice.choice(places)
    value = inside[key]
    if isinstance(value, int | float) and choice.random() < 0.7:
        inside[key] = choice.choice(
            (*NUMBERS, -value, value * 10, value / 3, value + 1, value * 1e6, str(value), [value])
        )
        return
    match choice.randrange(9):
        case 0:
            del inside[key]
        case 1 if isinstance(inside, list):
            inside[key:key] = [value] * choice.choice((1, 1, 3, 50))
        case 1:
            inside[f"{key}{choice.choice(('', '_', 's', 'x' * 400))}"] = value
        case 2:
            other, there = choice.choice(places)
            if isinstance(other, dict | list) and (there in other if isinstance(other, dict) else there < len(other)):
                inside[key], other[there] = other[there], value
        case 3:  # the same node at two places: an alias
            other, there = choice.choice(places)
            if not (isinstance(value, dict | list) and any(each is other for each, _ in [(value, 0), *_places(value)])):
                other[there] = value
        case 4 if isinstance(inside, dict):
            inside[choice.choice((*TEXTS, 1, None, True))] = inside.pop(key)
        case 5 if choice.random() < 0.2:
            inside[key] = _bomb(choice.choice((2, 5, 8)))
        case 6 if isinstance(value, str):
            inside[key] = choice.choice((value.upper(), value + "x", value[:-1], value * 500, f" {value}"))
        case _:
            inside[key] = _others(choice)


# ---------------------------------------------------------------- mutations of its text

FRAGMENTS = (
    b"!!timestamp x",
    b"!!python/object/apply:os.getcwd []",
    b"!!binary x",
    b"!!set {1}",
    b"&a [*a]",
    b"*b",
    b"<<: {a: 1}",
)
FRAGMENTS += (
    b"---\n",
    b"...\n",
    b"%YAML 9.9\n",
    b"\t",
    b"\x00",
    b"\xff\xfe",
    b"\xc2\xb2",
    b"? ",
    b": ",
    b"- ",
    b"| \n",
    b"{",
    b"]",
    b"'",
)
FRAGMENTS += (
    b"2001-99-99",
    b"0x",
    b"1:2:3",
    b".nan",
    b"9" * 5000,
    b"x" * 400,
    b"#",
    b"\r",
    b"\xef\xbb\xbf",
    b"!!int 0b",
    b"!!float ''",
)


def _spoil_text(text: bytes, choice: random.Random) -> bytes:
    at = choice.randrange(len(text) + 1)
    lines = text.split(b"\n")
    one, other = choice.randrange(len(lines)), choice.randrange(len(lines))
    match choice.randrange(8):
        case 0:
            return text[:at]
        case 1:
            return text[:at] + bytes([choice.randrange(256)]) + text[at + 1 :]
        case 2:
            return text[:at] + choice.choice(FRAGMENTS) + text[at:]
        case 3:
            return text[:at] + text[at + choice.choice((1, 2, 10, 100)) :]
        case 4:
            lines[one], lines[other] = lines[other], lines[one]
        case 5:
            lines.insert(other, lines[one])
        case 6:
            del lines[one]
        case _:  # a number, or a word, is another
            words = list(re.finditer(rb"[-\w.]+", text))
            if words:
                word = choice.choice(words)
                new = choice.choice((*(str(each).encode() for each in NUMBERS), *FRAGMENTS))
                return text[: word.start()] + new + text[word.end() :]
    return b"\n".join(lines)


# ---------------------------------------------------------------- cases

SHARES = {"scenario": 44, "map": 20, "floor": 12, "play": 10, "arm": 8, "sweep": 6}
"""How many of a hundred documents are of a kind: what is cheap comes often."""


def drawn(seed: int) -> Document:
    """Return the spoilt document of *seed*."""
    choice = random.Random(seed)
    kind = choice.choices([*SHARES], [*SHARES.values()])[0]
    document = choice.choice(sources()[kind])()
    text = document.files[document.spoilt]
    times = choice.choice((1, 1, 1, 2, 3))
    if document.spoilt.endswith(".yaml") and choice.random() < 0.6:
        plain = yaml.load(text, _Loader)
        for _ in range(times):
            _spoil_structure(plain, choice)
        try:
            text = yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=choice.random() < 0.5).encode()
        except RecursionError:  # lists in lists, deeper than they can be written; than they can be read they are, too
            text = b"[" * 2000
    else:
        for _ in range(times):
            text = _spoil_text(text, choice)
    return document._replace(files={**document.files, document.spoilt: text})


def write(document: Document, folder: Path) -> None:
    """Write the files of *document* into *folder*."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in document.files.items():
        (folder / name).write_bytes(content)


if __name__ == "__main__":
    write(drawn(int(sys.argv[1])), Path(sys.argv[2]))
