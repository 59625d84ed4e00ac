"""The metrics of a run are what its trace says: one Bluetooth run, recounted from messages, events and calls."""

from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from cosim.scenario import Scenario
from cosim.simulation import Outcome, simulate
from cosim.trace import CALLS, MESSAGES
from protocols.pseudonet.messages import Kind, Message, decode


@cache
def run() -> Outcome:
    plain = {
        "name": "metrics",
        "duration_s": 600,
        "floorplan": {"map": "walls", "walls": [[0, 0, 4, 0], [0, 2.5, 4, 2.5]]},
        "team": {"size": 3},
        "channel": {"kind": "bluetooth"},
        "protocol": {"use": "pseudonet", "parameters": {"algorithm": "oscard", "trace_calls": True}},
    }
    return simulate(Scenario.model_validate(plain).placed(Path()), 5, (CALLS, MESSAGES))


def times_of(call: str) -> list[int]:
    calls = run().trace.columns("calls")
    return [time for time, name in zip(calls["time_ns"], calls["call"], strict=True) if name == call]


def events(name: str) -> list[tuple[int, int, int]]:
    """Return the index, time and robot of each event *name*."""
    columns = run().trace.columns("events")
    rows = zip(columns["time_ns"], columns["source"], columns["event"], strict=True)
    return [(index, time, robot) for index, (time, robot, event) in enumerate(rows) if event == name]


@pytest.mark.slow
def test_the_set_up_lasts_from_the_start_until_each_robot_knows_its_team() -> None:
    first = {robot: time for _, time, robot in reversed(events("TeamFormed"))}
    assert sorted(first) == [0, 1, 2]
    assert run().metrics["setup_s"] == pytest.approx(sum(first.values()) / 3 / 1e9, abs=1e-9)


@pytest.mark.slow
def test_inquiry_and_paging_last_from_the_request_to_the_answer() -> None:
    (inquiry,) = times_of("hci.inquiry")
    pages = times_of("hci.create_connection")
    ready = min(time for _, time, robot in events("TeamFormed") if robot == 0)
    assert len(pages) == 2
    assert run().metrics["inquiry_s"] == pytest.approx((pages[0] - inquiry) / 1e9, abs=1e-9)
    assert run().metrics["page_s"] == pytest.approx((ready - pages[0]) / 1e9, abs=1e-9)
    assert run().metrics["inquiry_s"] > 0.01


@pytest.mark.slow
def test_exchanges_are_counted_by_the_masters_own_messages_and_steps_by_agreements() -> None:
    heard = run().trace.columns("messages")
    packets = [
        decode(bytes.fromhex(payload))
        for payload, robot, to_all in zip(heard["payload"], heard["source"], heard["broadcast"], strict=True)
        if robot == 1 and to_all
    ]
    own = [packet for packet in packets if isinstance(packet, Message) and packet.source == 0]
    assert run().metrics["exchanges"] == len(own)
    assert len(own) > 10
    assert run().metrics["steps"] == len([robot for _, _, robot in events("Stepped") if robot == 2])


@pytest.mark.slow
def test_messages_are_counted_by_type() -> None:
    kinds = run().trace.columns("events")["kind"]
    sent = Counter(kinds[index] for index, _, _ in events("MessageSent"))
    assert sent["state"] > 0
    for kind in (Kind.STATE, Kind.HELP, Kind.ANSWER, Kind.TRAP, Kind.STOP):
        assert run().metrics[f"messages_{kind.name.lower()}"] == sent[kind.name.lower()]
