"""docs/faults.md names every kind, field and event, and its example is a scenario with all of them."""

import re
from typing import get_args

import pytest
import yaml

from cosim.faults.events import EVENTS, events_of
from cosim.faults.settings import FaultSettings
from cosim.scenario import Scenario
from cosim.settings import Settings
from cosim.simulation import simulate
from tests.checkout import ROOT

PAGE = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
KINDS: tuple[type[Settings], ...] = get_args(get_args(FaultSettings)[0])


def example() -> Scenario:
    (lines,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    return Scenario.model_validate(yaml.safe_load(lines))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_a_kind_has_a_row_with_the_fields_of_its_own(kind: type[Settings]):
    name = kind.model_fields["kind"].default
    (row,) = [line for line in PAGE.splitlines() if line.startswith(f"| `{name}` |")]
    when = {"kind", "at_s", "rate_per_s", "until_s", "for_s"}
    assert {*re.findall(r"`(\w+)`", row.split("|")[2])} == kind.model_fields.keys() - when


def test_every_event_is_named():
    assert {event.__name__ for event in EVENTS} <= {*re.findall(r"`(\w+)`", PAGE)}


def test_the_example_has_all_kinds():
    assert {type(fault) for fault in example().faults} == {*KINDS}


@pytest.mark.slow
def test_the_example_runs_and_its_faults_are_in_the_trace():
    made = example()
    happened = {*simulate(made, 1).trace.columns("events")["event"]}
    # one is frozen, and the jammer on, until the end of the run; and where one is moved to is room
    assert {event.__name__ for event in events_of(made.faults)} - happened <= {"Thawed", "NotCarried", "JammerOff"}
