"""No decoder of the project is broken by bytes: 100,000 spoilt frames into each, and nothing but what it documents."""

import ast
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import pytest

from tests.bad_bytes import NONE, decoders, spoilt
from tests.checkout import ROOT
from tests.tiers import soak_count

FRAMES = 100_000
NAMES = sorted(decoders())


def documented(folder: Path) -> Iterator[str]:
    """Yield the public functions of modules that take bytes and say that they raise WireError."""
    for path in sorted(folder.rglob("*.py")):
        module, text = ".".join(path.relative_to(ROOT).with_suffix("").parts), path.read_text(encoding="utf-8")
        for node in ast.parse(text).body if "WireError" in text else ():
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                takes = {ast.unparse(each.annotation) for each in node.args.args if each.annotation is not None}
                if "bytes" in takes and "WireError" in (ast.get_docstring(node) or ""):
                    yield f"{module}.{node.name}"


def test_every_function_that_says_so_is_given_bad_bytes() -> None:
    found = {name for folder in ("cosim", "protocols") for name in documented(ROOT / folder)}
    assert len(found) > 25
    assert not found - set(NAMES)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_frames_that_are_whole_are_taken(name: str) -> None:
    decoder = decoders()[name]
    frames = decoder.frames()
    assert frames
    for frame in frames:
        decoder.take(frame)
        decoder.take(decoder.mend(frame))


@pytest.mark.soak
@pytest.mark.parametrize("name", NAMES)
def test_spoilt_frames_are_decoded_or_refused(name: str, record_property: Callable[[str, object], None]) -> None:
    decoder, random = decoders()[name], Random(name)
    frames, outcomes = decoder.frames(), Counter[str]()
    for number in range(soak_count(FRAMES)):
        frame = spoilt(random, frames)
        frame = decoder.mend(frame) if number % 2 else frame
        try:
            decoder.take(frame)
        except decoder.refuses:
            outcomes["refused"] += 1
        except Exception as error:  # a broken decoder may raise anything; raised again with the frame that broke it
            error.add_note(f"frame {number}: {frame.hex()}")
            raise
        else:
            outcomes["taken"] += 1
    assert set(outcomes) == ({"taken"} if decoder.refuses == NONE else {"taken", "refused"})
    record_property(f"spoilt frames into {name}, taken and refused", f"{outcomes['taken']} {outcomes['refused']}")
    print(f"{name}: {outcomes.total()} frames, {dict(outcomes)}")
