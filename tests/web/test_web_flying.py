"""What a run under way tells of frames on the air at a moment in their middle, against what the finished run tells."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest

from cosim.channels.base import Flying
from cosim.experiment import scenario_named
from cosim.simulation import Simulation
from cosim.trace import TABLES, Trace
from cosim.units import S, Time
from cosim.web.air import RecentAir
from cosim.web.live import Tap
from cosim.web.timeline import AskBox, Grown

ROOT = Path(__file__).parents[2]
MOMENTS = 20


class Case(NamedTuple):
    scenario: str
    begin: Time
    end: Time
    kinds: frozenset[str]
    sets: tuple[str, ...] = ()


CASES = {
    "802.11": Case(str(ROOT / "examples" / "4_two_radios.yaml"), 0, 8 * S, frozenset({"DATA", "ACK"})),
    "Bluetooth": Case(
        str(ROOT / "docs" / "pictures" / "jammer_with_afh.yaml"),
        0,
        9 * S,
        frozenset({"ID", "FHS", "POLL", "NULL", "DM1"}),
    ),
    "bridges": Case(
        "scatternet_coverage",
        8 * S,
        12 * S,
        frozenset({"POLL", "NULL", "DM1"}),
        ("channel={kind: bluetooth, idle_frames: true}", "team.size=8", "protocol.parameters.piconet_size=4"),
    ),
}


def simulation(case: Case, trace: type[Trace] = Trace) -> Simulation:
    run = Simulation(scenario_named(case.scenario, case.sets), 1, tuple(TABLES.values()), trace)
    run.begin()
    return run


def finished(case: Case) -> tuple[pd.DataFrame, str]:
    """Return all that was on the air in the finished run, and its digest."""
    run = simulation(case)
    run.advance(case.end)
    digest = run.outcome().digest
    return pd.DataFrame(run.trace.columns("transmissions")), digest


def moments(sent: pd.DataFrame, case: Case) -> list[Time]:
    """Return moments in the middle of frames of all kinds, in order."""
    stream, chosen = np.random.default_rng(3), []
    frames = sent[(sent.time_ns > case.begin) & (sent.time_ns + sent.duration_ns < case.end)]
    per_kind = -(-MOMENTS // len(case.kinds))
    for kind in sorted(case.kinds):
        of_kind = frames[frames.kind == kind]
        for row in of_kind.iloc[stream.choice(len(of_kind), min(per_kind, len(of_kind)), replace=False)].itertuples():
            chosen.append(int(row.time_ns + stream.integers(1, row.duration_ns)))
    return sorted(chosen)


def of_table(sent: pd.DataFrame, at: Time) -> set[tuple[Any, ...]]:
    rows = sent[(sent.time_ns < at) & (at <= sent.time_ns + sent.duration_ns)]
    radios = rows.radio if "radio" in rows else [0] * len(rows)
    columns = rows.time_ns, rows.source, rows.kind, rows.destination, rows.duration_ns, rows.channel, rows.lt_addr
    return set(zip(*columns, rows.length, radios, strict=True))


def of_flying(each: Flying) -> tuple[Any, ...]:
    more = each.channel, each.lt_addr, each.length, each.radio
    return each.start, each.source, each.kind, each.destination, each.end - each.start, *more


@pytest.mark.parametrize("name", CASES)
def test_at_a_pause_all_that_is_on_the_air_is_told(name: str):
    case = CASES[name]
    sent, digest = finished(case)
    run, known = simulation(case, Tap), 0
    trace: Any = run.trace
    grown, air = Grown(trace.tables.values()), RecentAir()
    chosen = moments(sent, case)
    assert len(chosen) >= MOMENTS
    for at in chosen:
        run.advance(at)
        flying = run.present.flying
        told = {of_flying(each) for each in flying}
        expected = of_table(sent, at)
        assert expected
        assert expected <= told, at
        assert {row[2] for row in told - expected} <= {"ID"}  # which are rows if somebody has heard them
        grown.take(trace.grown(), run.present)
        air.put(flying)
        on_floor = {(*row[2:5], row[5], row[10]) for row in air.at(at, 1.0)["frames"]}
        assert {(row[1], row[3], row[2], "", row[8]) for row in expected} <= on_floor
        known += in_lanes(grown, expected)
    run.advance(case.end)
    assert run.outcome().digest == digest  # to look changes nothing
    assert known >= MOMENTS


def in_lanes(grown: Grown, expected: set[tuple[Any, ...]]) -> int:
    """Check that lanes have a box for each frame that is *expected*, with what is known of it; return their number."""
    lanes = grown._growing.lanes
    for start, source, kind, destination, duration, channel, _, length, radio in expected:
        (number,) = (at for at, lane in enumerate(lanes) if lane.named[:3] == (source, radio, "sent"))
        boxes = lanes[number].under_way
        (at,) = np.flatnonzero(boxes.starts == start).tolist()
        box = grown.answer(AskBox(say="box", lane=number, row=int(boxes.rows[at])))
        assert isinstance(box, dict)
        names = "time_ns", "kind", "destination", "duration_ns", "channel", "length"
        told = [box["fields"][each] for each in names]
        assert told == [str(start), kind, destination, str(duration), channel, length]
        there = [lane for lane in lanes if lane.named.what == "channel" and lane.named.channel == channel]
        assert channel < 0 or any(start in lane.under_way.starts for lane in there)
    return len(expected)
