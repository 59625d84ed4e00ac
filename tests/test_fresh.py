"""The script behind ``make fresh``: how it reads a page, and that it notices what does not end as it should."""

import os
import re
from pathlib import Path

import pytest

from tests.fresh import ROOT, Place, StepError, Told, do, left_out, made_by, perform, provide, shortened, told

PAGE = """\
# a page

Some words, and `code`.

    make run        # sets things up
    . .venv/bin/activate

```yaml
# first.yaml
name: anything
```

    cosim run second.yaml --set 'a={b: 1,  c: 2}' && cosim view "out && about"   one thing and another
    cosim run third.yaml \\
        --trace out

Write this into `third.yaml`:

```
duration_s: 1
```

```
name: second
```

```
channel: {kind: ideal}     # a fragment
```

```python
print(1)
```

    cosim/     what is inside
      web/     make view

```sh
# a remark
$ unusual --words
```

```powershell
dir
```
"""


def test_the_steps_of_a_page_are_its_commands_in_order() -> None:
    assert told(PAGE).steps == [
        "make run",
        ". .venv/bin/activate",
        "cosim run second.yaml --set 'a={b: 1,  c: 2}'",
        'cosim view "out && about"',
        "cosim run third.yaml --trace out",
        "python readme_31.py",
        "unusual --words",
    ]


def test_the_files_of_a_page_go_by_the_names_that_it_tells() -> None:
    assert told(PAGE).files == {
        "first.yaml": "# first.yaml\nname: anything\n",
        "third.yaml": "duration_s: 1\n",
        "second.yaml": "name: second\n",
        "readme_31.py": "print(1)\n",
    }


def test_every_file_that_the_readme_reads_is_told_there_or_is_the_users() -> None:
    page = told((ROOT / "README.md").read_text(encoding="utf-8"))
    read = {name for step in page.steps for name in re.findall(r"(?<![\w./-])[\w./-]+\.yaml", step)}
    assert "four.yaml" in read
    assert not [name for name in read if name not in page.files and not (ROOT / name).exists() and name[:2] != "my"]


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place("here", tmp_path, dict(os.environ))


@pytest.mark.parametrize(
    ("step", "why"),
    [
        ("echo lost; exit 3", "exit code 3\nlost\n"),
        ("true --trace out", "out is not there\n"),
        ("echo figure: a.jpg", "a.jpg is not there\nfigure: a.jpg\n"),
        ("touch run.png", "run.png is not there\n"),  # empty
        (". .venv/bin/activate", ".venv/bin/activate is not there"),
    ],
)
def test_a_step_that_does_not_end_as_it_should_is_noticed(place: Place, step: str, why: str) -> None:
    with pytest.raises(StepError) as raised:
        perform(place, step)
    assert str(raised.value) == why


def test_a_failed_step_is_shown_with_what_it_has_printed(place: Place, capsys: pytest.CaptureFixture[str]) -> None:
    do(place, "echo lost; false", Told(), everything=False)
    do(place, "echo found > out", Told(), everything=False)
    shown = capsys.readouterr().out
    assert re.fullmatch(
        r" +\d+\.\d s  echo lost; false   FAILED\n    \| exit code 1\n    \| lost\n +\d+\.\d s  echo found > out\n",
        shown,
    )
    assert place.failed == ["echo lost; false"]


def test_an_activated_environment_is_that_of_the_steps_after_it(place: Place) -> None:
    programs = place.folder / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "activate").touch()
    (programs / "cosim").write_text("#!/bin/sh\necho $VIRTUAL_ENV $1 > found\n")
    (programs / "cosim").chmod(0o755)
    perform(place, ". .venv/bin/activate")
    perform(place, "cosim list")
    assert (place.folder / "found").read_text() == f"{programs.parent} list\n"


def test_what_is_the_users_is_provided(place: Place) -> None:
    page = Told([], {"four.yaml": "name: four\n"})
    provide(place.folder, "cosim sweep x --set floorplan.map=my.yaml", page)
    assert "image: my_floor.pgm" in (place.folder / "my.yaml").read_text()
    provide(place.folder, "cosim run my.yaml", page)
    assert (place.folder / "my.yaml").read_text() == "name: four\n"


def test_what_takes_long_is_cut_down_or_left_out_with_a_reason(place: Place, tmp_path: Path) -> None:
    assert shortened("cosim sweep a/b --jobs 2") == "cosim sweep a/b --jobs 2 --quick -o results/b"
    assert shortened("cosim sweep a --quick") == "cosim sweep a --quick"
    assert left_out(place, "make test", Told(), everything=False) == "long; --all does it"
    assert left_out(place, "make test", Told(), everything=True) is None
    assert left_out(place, "make run", Told(), everything=False) is None
    elsewhere = Place("elsewhere", tmp_path, {}, clone=ROOT)
    for step in ("make run", "pip install -e .", "python3 -m venv .venv", ". .venv/bin/activate"):
        assert left_out(elsewhere, step, Told(), everything=True) == "the wheel is installed"
    only = left_out(elsewhere, "cosim run tests/data/beacon.py", Told(), everything=True)
    assert only == "tests/data/beacon.py is in the checkout only"
    assert made_by(["cosim", "run", "x", "--trace", "out"], "") == ["out"]
