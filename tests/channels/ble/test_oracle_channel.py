"""The channel equals a plain model of it, event for event: all that reaches hosts, where and when."""

from collections.abc import Sequence
from typing import Any

import pytest

from cosim.channels.ble.settings import BleSettings
from tests.channels.ble.ble_field import Field
from tests.oracles.campaign import Seeded
from tests.oracles.le_cases import KINDS, Case, Do, Move, Power, Send, draw_case
from tests.oracles.le_channel import LeChannel
from tests.tiers import soak_count

DEFAULT = 15
"""Cases in CI, of all kinds together."""
CI = range(3, 3 + DEFAULT // len(KINDS))
Rows = list[tuple[int, int, str]]


def by_channel(case: Case) -> Rows:
    """Return what reaches hosts over the channel."""
    field = Field(case.size, case.seed, **case.settings)
    places = [(0.0, 0.0)] * case.size
    for time, act in case.script:
        field.until(max(time, field.kernel.now))
        match act:
            case Do(address, command):
                field.do(address, command)
            case Send(address, outgoing):
                field.channel.send(address, outgoing)
            case Power(address, on):
                field.channel.power(address, on)
            case Move(address, x_m, y_m):
                places[address] = x_m, y_m
                field.move(places)
    field.until(case.until)
    return in_order(field.news)


def by_oracle(case: Case) -> Rows:
    """Return what reaches hosts by the plain model."""
    model = LeChannel(case.size, case.seed, BleSettings(**case.settings))
    places = [(0.0, 0.0)] * case.size
    for time, act in case.script:
        model.until(max(time, model.now))
        match act:
            case Do(address, command):
                model.do(address, command)
            case Send(address, outgoing):
                model.send(address, outgoing)
            case Power(address, on):
                model.power(address, on)
            case Move(address, x_m, y_m):
                places[address] = x_m, y_m
                model.move(places)
    model.until(case.until)
    return in_order(model.news)


def in_order(news: Sequence[tuple[int, int, Any]]) -> Rows:
    """Return *news* as text; what reaches one host at one instant has no order but that of its text."""
    return sorted((time, address, told(what)) for time, address, what in news)


def told(what: object) -> str:
    if not isinstance(what, tuple):
        return str(what)
    payload, (source, broadcast, rssi_dbm, radio) = what
    power = None if rssi_dbm is None else round(rssi_dbm, 6)
    return f"{len(payload)} x {payload[:1]!r} of {source}, {broadcast=}, {power=}, {radio=}"


def compare(kind: str, seeds: range) -> Rows:
    rows: Rows = []
    for seed in seeds:
        case = draw_case(Seeded(KINDS.index(kind), seed), kind)
        found, expected = by_channel(case), by_oracle(case)
        assert found == expected, f"{kind}, seed {seed}"
        rows += found
    return rows


@pytest.mark.parametrize("kind", KINDS)
def test_hosts_are_told_what_a_plain_model_tells_them(kind: str) -> None:
    assert compare(kind, CI)


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_hosts_are_told_the_same_in_many_runs(kind: str) -> None:
    rows = compare(kind, range(CI.stop, CI.stop + -(-soak_count(10_000) // len(KINDS))))
    assert len(rows) > len(KINDS)
