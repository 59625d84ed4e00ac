"""The lines in CONTRIBUTING that a protocol needs over Bluetooth are enough, and run over the other channels too."""

import re
import sys
from typing import Any

import pytest

from cosim.machine import Outgoing, Reception
from cosim.protocol import Metric, ProtocolSpec, anywhere
from cosim.scenario import Scenario
from cosim.settings import Settings
from cosim.simulation import simulate
from cosim.units import MS, S, Time
from tests.checkout import ROOT

CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
SIZE = 5


class Parameters(Settings):
    """None."""


class Talker:
    """Tells all its number every second, and notes whose it has heard."""

    finished = False

    def __init__(self, parameters: Parameters, size: int, me: int, stream: Any, start: Time) -> None:
        names: dict[str, Any] = {}
        (lines,) = re.findall(r"```python\n(.*?)```", CONTRIBUTING, re.DOTALL)
        exec(lines, names)  # our own page
        self.star = names["Star"](me, size)
        self.me, self.deadline, self.heard = me, start + S + me * 100 * MS, set[int]()  # not all at once

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard |= {data[0]} - {self.me}
        self.star.receive(data, reception)

    def link(self, event: Any, now: Time) -> None:
        self.star.link(event)

    def observe(self, observation: Any, now: Time) -> None:
        pass

    def wake(self, now: Time) -> None:
        self.deadline = now + S
        if self.star.linked:
            self.star.tell_all(bytes([self.me]))

    def wake_at(self) -> Time:
        return self.deadline

    def outbox(self) -> list[Outgoing]:
        drained, self.star.out = self.star.out, []
        return drained

    def commands(self) -> list[Any]:
        return []

    events = commands


class Judge:
    """Ends nothing."""

    def __init__(self, *_: Any) -> None:
        pass

    def look(self, x_m: Any, y_m: Any, now: Time) -> bool:
        return False

    def verdict(self, now: Time) -> dict[str, float]:
        return {}


SPEC = ProtocolSpec(
    name="talkers",
    parameters=Parameters,
    place=anywhere,
    prepare=lambda parameters, surroundings: len(surroundings.starts_m),
    make=Talker,  # type: ignore[arg-type]
    referee=Judge,
    metrics=(Metric("pairs", "1", "pairs of robots of which one has heard of the other"),),
    measure=lambda machines: {"pairs": float(sum(len(machine.heard) for machine in machines))},
    events=(),
)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ideal", "optical", "adhoc", "bluetooth"])
def test_everybody_hears_of_everybody(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "talkers", sys.modules[__name__])
    plain = {
        "duration_s": 40,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 6, 6]},
        "team": {"size": SIZE},
        "channel": {"kind": kind},
        "protocol": {"use": "talkers:SPEC"},
    }
    outcome = simulate(Scenario.model_validate(plain), 1)
    assert outcome.metrics["pairs"] == SIZE * (SIZE - 1)
    assert outcome.metrics["payloads_unsent"] == 0
    assert outcome.notices == ()
