"""The experiment routing_recovery: its scene, what it measures, and how its claims are judged."""

import math
from functools import partial
from pathlib import Path
from typing import Any

import networkx as nx
import pandas as pd
import pytest

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.state import HEARD, Report
from cosim.experiment import load_experiment
from cosim.machine import BROADCAST, Outcome
from cosim.report.sweep_report import report
from cosim.sweep import run_sweep
from cosim.units import S
from experiments.routing_recovery import figures, recovery
from experiments.routing_recovery.omniscient import Omniscient, reach
from experiments.routing_recovery.recovery import COLUMNS, SHAPES, Course, Parameters, measure, steady_s
from tests.checkout import EXPERIMENTS

FOLDER = EXPERIMENTS / "routing_recovery"
AODV = {"kind": "aodv", "net_diameter": 8}
SHORT = {"settle_s": 0.0, "before_s": 2.0, "window_s": 1.0, "watch_s": 6.0}


def given(routing: dict[str, Any] | None, shape: str = "diamond", **said: float) -> dict[str, Any]:
    return {"radio": {"kind": "adhoc", "range_m": 20, "routing": routing}, "shape": shape, **said}


@pytest.mark.parametrize(("shape", "hops", "relays"), [("diamond", 2, 2), ("ladder", 4, 2), ("ring", 4, 1)])
def test_there_is_another_way_as_short_as_the_first(shape: str, hops: int, relays: int) -> None:
    places_m, destination = SHAPES[shape]
    graph = reach(places_m, 20.0)
    ways = list(nx.all_shortest_paths(graph, 0, destination))
    assert {len(way) - 1 for way in ways} == {hops}
    for relay in {way[-2] for way in ways}:
        others = graph.subgraph(set(graph) - {relay})
        assert nx.shortest_path_length(others, 0, destination) == hops
    # in the ring a robot before the relay has only the way back to the source
    assert len(graph[ways[0][-3]].keys() & graph[destination].keys()) == relays


def test_an_omniscient_router_loses_nothing_and_says_nothing() -> None:
    for seed in range(2):
        row = measure(given(None, **SHORT), seed)
        assert list(row) == [column.name for column in COLUMNS]
        assert (row["lost"], row["steady_s"], row["control_octets_per_s"]) == (0.0, 0.0, 0.0)
        assert 0.0 < row["recovery_s"] < row["outage_s"] < 0.2
        assert row["frames_per_payload"] == pytest.approx(4.0, abs=0.2)  # two hops, each with an ACK
        assert math.isnan(row["noticed_s"])


def test_an_omniscient_router_takes_another_way_or_tells_that_there_is_none() -> None:
    graph = reach(SHAPES["diamond"][0], 20.0)
    one = Omniscient(0, graph)
    one.send(3, b"payload", 7, 0)
    (hop,) = one.hops()
    graph.remove_node(hop.destination)
    assert hop.token is not None
    one.hop_done(hop.token, False, 1)
    (again,) = one.hops()
    assert {hop.destination, again.destination} == {1, 2}
    graph.remove_node(again.destination)
    assert again.token is not None
    one.hop_done(again.token, False, 2)
    assert (one.hops(), one.fates()) == ([], [(7, Outcome.NO_ROUTE)])


def test_who_dies_is_the_last_relay_of_the_way_in_use_at_a_random_instant() -> None:
    deaths = set()
    for seed in range(3):
        course = Course(Parameters.model_validate(given(AODV, "ring", **SHORT)), seed)
        course.kernel.run(course.end)
        assert course.relay in {3, 5}
        assert course.sender == {3: 2, 5: 6}[course.relay]
        assert 2 * S <= course.death - course.begin <= 3 * S
        deaths.add(course.death - course.begin)
    assert len(deaths) == 3


def test_two_runs_with_a_seed_are_alike() -> None:
    assert measure(given(AODV, **SHORT), 1) == measure(given(AODV, **SHORT), 1) != measure(given(AODV, **SHORT), 2)


def test_with_feedback_of_the_mac_one_payload_is_enough() -> None:
    row = measure(given(AODV | {"use_hello": False}, "ring", **SHORT), 3)
    assert (row["tries"], row["lost"]) == (1.0, 1.0)
    assert row["noticed_s"] < row["recovery_s"] < 0.3


@pytest.mark.parametrize("seed", [46, 97, 99])
def test_a_payload_that_the_death_finds_in_the_station_is_one_that_the_dead_relay_was_sent(seed: int) -> None:
    course = Course(Parameters.model_validate(given(AODV | {"use_hello": False}, "ring", **SHORT)), seed)
    course.kernel.run(course.death - 1)
    (relay,) = {course.channel.last_relay} - {None}
    link = course.channel.sender_over[relay], relay
    assert course.channel.sent_to[link] == course.channel.done_with[link] + 1  # as this case wants it
    course.kernel.run(course.end)
    assert (course.relay, course.tries, course.channel.sent_to[link]) == (relay, 1, course.channel.done_with[link])


@pytest.mark.slow
def test_without_it_two_seconds_of_silence_are_needed() -> None:
    for seed in range(3):
        row = measure(given(AODV | {"use_mac_feedback": False}, **SHORT), seed)
        assert 2.0 <= row["silence_s"] < 2.02
        assert 0.98 <= row["noticed_s"] < 2.02
        assert row["lost"] == row["tries"] > 9
        assert row["steady_s"] == row["recovery_s"]


@pytest.mark.slow
def test_a_second_interruption_is_seen_and_goes_if_tcs_tell_of_all_neighbours() -> None:
    """OLSR in the ladder: who is left tells nothing of the destination until that has chosen another relay."""
    olsr = {"kind": "olsr", "use_mac_feedback": True}
    row = measure(given(olsr, "ladder"), 1)
    assert row["recovery_s"] < 0.2
    assert 4 < row["steady_s"] < 14
    assert row["lost"] > 40
    full = measure(given(olsr | {"tc_redundancy": 2}, "ladder"), 1)
    assert full["steady_s"] == 0.0
    assert full["lost"] < 5


class Lossless(recovery.Observed):
    """A channel on which frames to all are received by all in reach, even if they collide."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._stations._common["noted"] = True

    def noted(self, report: Report, packet: Packet | None) -> None:
        super().noted(report, packet)
        if report.what == HEARD and not report.right and report.destination == BROADCAST:
            assert packet is not None
            ends = report.begin + report.duration + self._settings.timing().delay
            # reports for tables come with the next one for a host, which may be later
            self.kernel.at(max(ends, self.kernel.now), partial(self._receive, report, packet))

    def _receive(self, report: Report, packet: Packet) -> None:
        if self._on[report.station]:
            self.received([report.station], report.source, packet, [report.mw])


FAST_MAC = {"kind": "olsr", "hello_interval_s": 0.5, "refresh_interval_s": 0.5, "tc_interval_s": 2}
FAST_MAC |= {"use_mac_feedback": True}


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "seed"), [("ring", 23), ("ladder", 29)])
def test_olsr_keeps_its_bound_if_no_hello_and_no_tc_collides(
    shape: str, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the full sweep these two break it, after 25.4 s and 20.9 s: three TCs, or HELLOs, in a row collide."""
    monkeypatch.setattr(recovery, "Observed", Lossless)
    assert measure(given(FAST_MAC, shape), seed)["steady_s"] <= 1.5 + 0.5 + 2.0 + 0.25


@pytest.mark.slow
@pytest.mark.parametrize("seed", [19, 26])
def test_the_source_learns_within_a_tc_interval_if_no_tc_collides(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the full sweep these two take longer, 7.05 s and 7.38 s."""
    monkeypatch.setattr(recovery, "Observed", Lossless)
    row = measure(given({"kind": "olsr"}, "ring"), seed)
    assert row["recovery_s"] - row["noticed_s"] <= figures.TC_S


def test_payloads_come_steadily_when_the_last_long_gap_has_ended() -> None:
    tenths = [n * S // 10 for n in range(10, 100)]
    assert steady_s(tenths, S, 10 * S) == 0.0
    assert steady_s([time for time in tenths if not S < time < 3 * S], S, 10 * S) == 2.0
    gaps = [time for time in tenths if not (S < time < 3 * S or 5 * S < time < 6 * S)]
    assert steady_s(gaps, S, 10 * S) == 5.0
    assert math.isnan(steady_s(gaps, S, 11 * S))


@pytest.mark.slow
@pytest.mark.parametrize(("said", "silence_s"), [({}, 6.0), ({"hysteresis": True}, 4.0)])
def test_olsr_misses_hellos_for_the_hold_time_or_any_packets_with_hysteresis(
    said: dict[str, bool], silence_s: float
) -> None:
    for seed in (1, 4):  # in the last of them a packet with a TC alone comes after the last HELLO
        row = measure(given({"kind": "olsr", **said}, "ladder", before_s=2.0, watch_s=8.0), seed)
        assert silence_s <= row["silence_s"] < silence_s + 0.02


def test_a_way_that_never_comes_back_has_no_times() -> None:
    row = measure(given({"kind": "olsr"}, **SHORT | {"settle_s": 20.0, "watch_s": 3.5}), 1)
    assert all(math.isnan(row[name]) for name in ("outage_s", "recovery_s", "steady_s", "noticed_s", "tries"))
    assert 14 <= row["lost"] <= 16  # one each 100 ms for 1.5 s: the last 2 s do not count


# ---------------------------------------------------------------- claims


def frame(**columns: list[Any]) -> pd.DataFrame:
    size = len(next(iter(columns.values())))
    return pd.DataFrame({"replicate": range(size), **columns})


def test_whether_a_death_is_learnt_of_in_time_is_judged_by_the_worst_run() -> None:
    runs = frame(router=["olsr"] * 2, shape=["ring"] * 2, recovery_s=[8.0, 9.0], noticed_s=[5.0, 4.0])
    assert figures.learnt(runs, runs) == ("4, at most 5", True)
    assert figures.learnt(runs.assign(noticed_s=[5.0, 3.4]), runs)[1] is False
    assert figures.learnt(runs.assign(shape="ladder"), runs) == ("-", None)


def test_a_bound_is_broken_by_one_run_and_by_one_that_never_came_back() -> None:
    runs = frame(router=["olsr"] * 2, steady_s=[8.0, 14.0])
    assert figures.bounded_olsr(runs, runs)[1] is True
    assert figures.bounded_olsr(runs.assign(steady_s=[8.0, 14.1]), runs)[1] is False
    assert figures.bounded_olsr(runs.assign(steady_s=[8.0, math.nan]), runs) == ("never in 1 of 2 runs", False)
    assert figures.bounded_olsr_fast_mac(runs, runs) == ("-", None)


def arms(fast: dict[str, list[float]]) -> pd.DataFrame:
    """Return three replicates of 5, 6 and 7 s with OLSR in every shape, and with fast OLSR as given."""
    rows = []
    for shape, values in fast.items():
        for replicate, value in enumerate(values):
            rows.append({"router": "olsr", "shape": shape, "replicate": replicate, "outage_s": 5.0 + replicate})
            rows.append({"router": "olsr_fast", "shape": shape, "replicate": replicate, "outage_s": value})
    return pd.DataFrame(rows)


def test_shorter_has_to_be_shown_in_every_shape() -> None:
    clear = [1.0, 2.0, 2.5]
    assert figures.tuned_olsr(arms(dict.fromkeys(figures.SHAPES, clear)), pd.DataFrame())[1] is True
    unclear = arms({"diamond": clear, "ladder": clear, "ring": [1.0, 7.0, 7.1]})
    assert figures.tuned_olsr(unclear, pd.DataFrame())[1] is False
    assert figures.tuned_olsr(arms({shape: [1.0] for shape in figures.SHAPES}), pd.DataFrame())[1] is None
    assert figures.tuned_olsr(arms({"diamond": clear}), pd.DataFrame()) == ("-", None)


@pytest.mark.parametrize(("outage_s", "holds"), [(0.105, True), (0.112, False)])
def test_milliseconds_are_less_than_ten(outage_s: float, holds: bool) -> None:
    rows = [
        {"router": "aodv_mac", "shape": shape, "replicate": n, "outage_s": outage_s + n * 1e-4}
        for shape in figures.SHAPES
        for n in range(3)
    ]
    assert figures.milliseconds(pd.DataFrame(rows), pd.DataFrame())[1] is holds


@pytest.mark.slow
def test_a_sweep_is_reported_with_its_figure(tmp_path: Path) -> None:
    sets = ["router=aodv_mac", "shape=diamond", "settle_s=0", "watch_s=6"]
    experiment = load_experiment(FOLDER / "sweep.yaml", sets, replicates=2)
    assert run_sweep(experiment, tmp_path, jobs=1).failures == ()
    made = report(tmp_path)
    verdicts = {verdict.id: verdict.verdict for verdict in made.verdicts}
    assert verdicts["aodv_mac"] == "holds"
    assert verdicts["olsr_hold"] == verdicts["tc"] == verdicts["tuned_olsr"] == "no data"
    assert tmp_path / "recovery.png" in made.figures
