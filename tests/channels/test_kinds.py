"""Channels that packages bring: found by name, validated by their own settings; only what is named is loaded."""

import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from cosim.channels.kinds import channel_kinds, channel_models, channel_spec
from cosim.errors import UserError
from cosim.scenario import Scenario, build, dump
from cosim.simulation import Simulation, simulate
from cosim.trace import MESSAGES
from cosim.units import MS, S
from tests.checkout import DATA

PLAIN = {"duration_s": 8.0, "team": {"size": 2}, "protocol": {"use": "beacon:SPEC", "parameters": {"calls": 9}}}


@pytest.fixture(autouse=True)
def packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DATA))
    for name in ("beacon", "pigeons"):
        monkeypatch.delitem(sys.modules, name, raising=False)


@pytest.fixture
def points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a package installed that brings pigeons, and one that is broken."""
    ours = [EntryPoint(name, f"cosim.channels.{module}:SPEC", "cosim.channels") for name, module in OURS.items()]
    brought = [EntryPoint("pigeons", "pigeons:SPEC", "cosim.channels"), EntryPoint("smoke", "no.fire:SPEC", "x")]
    found = {point.name: point for point in (*ours, *brought)}
    monkeypatch.setattr("cosim.installed._points", lambda group: found)


OURS = {"ideal": "ideal", "radios": "radios"}


def scenario(channel: Any) -> Scenario:
    return build(PLAIN | {"channel": channel}, "depot.yaml", Path())


@pytest.mark.parametrize("kind", ["pigeons", "pigeons:SPEC"])
def test_a_channel_of_a_package_of_ones_own_carries_messages(kind: str, points: None) -> None:
    flown, at_once = (
        simulate(scenario(channel), 1, [MESSAGES]).trace.columns("messages")["time_ns"]
        for channel in ({"kind": kind, "loft_m": 60}, {"kind": "ideal", "delay_s": 0.001})
    )
    assert flown[0] - at_once[0] == 3 * S - 1 * MS  # 60 m at 20 m/s


def test_it_can_be_one_of_several_radios(points: None) -> None:
    two = scenario({"kind": "radios", "radios": [{"kind": "ideal"}, {"kind": "pigeons", "speed_mps": 5}]})
    assert [type(part).__name__ for part in Simulation(two, 1).channel.parts] == ["IdealChannel"] * 2
    assert dump(two)["channel"]["radios"][1] == {"kind": "pigeons", "loft_m": 100.0, "speed_mps": 5.0}
    assert Scenario.model_validate(dump(two)) == two


@pytest.mark.parametrize(
    ("channel", "said"),
    [
        ({"kind": "pigeons", "sped_mps": 3}, r"channel\.sped_mps: 3 is not expected here: .* did you mean speed_mps\?"),
        ({"kind": "pigeons", "loft_m": "far"}, r"channel\.loft_m: 'far' is not a valid number"),
        ({"kind": "radios", "radios": [{"kind": "pigeons", "a": 1}]}, r"channel\.radios\[0\]\.a: 1 is not expected"),
        ({"kind": "smoke"}, r"channel\.kind: 'smoke' is not a channel: No module named 'no'"),
        (
            {"kind": "pigeons:NO_SPEC"},
            r"channel\.kind: 'pigeons:NO_SPEC' is not a channel: a \w+, expected a ChannelSpec",
        ),
        (
            {"kind": "owls"},
            r"channel\.kind: 'owls' is not a channel: expected one of ideal, pigeons, radios, smoke, or mod",
        ),
        ({"kind": None}, r"channel\.kind: None is not a channel: expected one of"),
        ("pigeons", r"channel: 'pigeons' is not a mapping of settings, expected a mapping such as {kind: pigeons}"),
    ],
)
def test_what_is_wrong_with_a_channel_is_told_with_its_place(channel: Any, said: str, points: None) -> None:
    with pytest.raises(UserError, match=f"^depot.yaml: {said}"):
        scenario(channel)


def test_a_broken_package_fails_only_those_who_name_it(points: None) -> None:
    assert channel_kinds() == ["ideal", "pigeons", "radios", "smoke"]
    assert scenario({"kind": "ideal"}).channel.kind == "ideal"
    with pytest.raises(ValueError, match="No module named 'no'"):
        channel_spec("smoke")
    assert channel_models({"kind": "smoke"}) == {}


def test_nothing_is_loaded_but_the_channel_that_is_named() -> None:
    code = """
import sys
from cosim.channels.kinds import channel_kinds
from cosim.scenario import Scenario
assert {"adhoc", "bluetooth", "ideal"} <= {*channel_kinds()}
Scenario.model_validate({"duration_s": 1, "protocol": {"use": "monitoring"}, "channel": {"kind": "adhoc"}})
print(*sorted(name for name in sys.modules if name.startswith("cosim.channels.")))
"""
    words = [sys.executable, "-c", code]
    loaded = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
    assert "cosim.channels.adhoc.settings" in loaded
    assert not {"cosim.channels.adhoc.channel", "cosim.channels.vision"} & {*loaded}
    assert not [name for name in loaded if name.startswith("cosim.channels.bluetooth")]
