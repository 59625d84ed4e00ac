"""Hosts crash or are cut off: no run hangs, everybody finds a sub-team, and nothing that was reported is lost."""

from typing import Any

import pytest

from cosim.scenario import Scenario
from protocols.aggregation.host import Host
from tests.protocols.aggregation.fault_judge import Look, Watched, lost_reports, outsiders
from tests.protocols.aggregation.fault_schedules import HIDDEN_M, USE, Schedule, schedule
from tests.tiers import soak_count

BLOCKS = 10
FEW = 4
"""How many schedules of either kind CI runs before it comes to its share of the soak, which goes on from there."""
EVENTS_PER_S = 100.0
"""Kernel events a robot and second: ticks and frames are some 20."""


def wrongs(number: int, open_: bool) -> list[str]:
    """Run a schedule; return what the judge has to say."""
    run = Watched(schedule(number, open_))
    events = run.simulation.kernel.executed / (run.ended_s * run.size)
    wrong = [] if events < EVENTS_PER_S else [f"{events:.0f} events a robot and second"]
    if open_:
        return wrong + ignorant(run) + lost_reports(run)
    wrong += [] if run.whole else [f"ended after {run.ended_s} s, without the hidden target"]
    return wrong + outsiders(run.looks, run.hosts, run.schedule.quiet_s) + lost_reports(run)


def ignorant(run: Watched) -> list[str]:
    """Return which hosts do not know all targets, though the search has ended before its time."""
    targets = len(run.schedule.scenario.protocol.parameters.targets)  # type: ignore[attr-defined]
    alive = [] if run.whole else [host for host in range(run.hosts) if run.simulation.nodes[host].alive]
    return [f"host {host} does not know all" for host in alive if len(run.found_now(host)) < targets]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(FEW))
def test_after_faults_everybody_is_in_one_sub_team_and_no_report_is_lost(number: int) -> None:
    assert wrongs(number, open_=False) == []


@pytest.mark.slow
@pytest.mark.parametrize("number", range(FEW))
def test_a_search_with_faults_that_can_end_loses_no_report(number: int) -> None:
    assert wrongs(number, open_=True) == []


@pytest.mark.soak
@pytest.mark.parametrize("block", range(BLOCKS))
def test_in_a_thousand_schedules_everybody_is_in_one_sub_team_and_no_report_is_lost(block: int) -> None:
    """Beyond these some fail: in 1152 all hosts have rebooted, and nobody is left who could remind one of its searcher.

    It hears the other host, which does not know whose it is, until it meets its own.
    """
    numbers = range(FEW + block, FEW + soak_count(1000 - FEW), BLOCKS)
    assert {number: wrong for number in numbers if (wrong := wrongs(number, open_=False))} == {}


@pytest.mark.soak
def test_in_two_hundred_schedules_that_can_end_no_report_is_lost() -> None:
    numbers = range(FEW, FEW + soak_count(200 - FEW))
    assert {number: wrong for number in numbers if (wrong := wrongs(number, open_=True))} == {}


@pytest.mark.slow
@pytest.mark.parametrize("down_s", [2.0, 20.0])
def test_searchers_whom_a_rebooted_host_has_forgotten_and_does_not_hear_are_in_a_sub_team(down_s: float) -> None:
    """Host 1 boots in a far corner; searcher 3 is with it, 5 with host 0, and nobody moves."""
    body = {"radius_m": 0.2, "speed_mps": 1.0}
    stand = [{"kind": "frozen", "robot": robot, "at_s": 4.0} for robot in range(6)]
    away = [{"kind": "moved", "robot": robot, "at_s": 6.0, "to_m": at} for robot, at in ((1, (38, 38)), (3, (36, 36)))]
    plain = {
        "duration_s": 102.0,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 40, 40]},
        "team": {"groups": [{"size": 2, "body": body, "radios": [0, 1]}, {"size": 4, "body": body, "radios": [0]}]},
        "channel": {"kind": "radios", "radios": [{"kind": "ideal", "range_m": 10.0}, {"kind": "ideal"}]},
        "faults": [*stand, *away, {"kind": "crash", "robot": 1, "at_s": 60.0 - down_s, "for_s": down_s}],
        "protocol": {"use": USE, "parameters": {"strategy": "mi", "hosts": 2, "targets": [HIDDEN_M], "short_m": 10.0}},
    }
    run = Watched(Schedule(1, Scenario.model_validate(plain), quiet_s=60.0))
    last = run.looks[-1]
    assert not last.mutual(0, 1, 5)
    assert last.mutual(0, 0, 5)
    assert last.lists[1][3] == last.claims[3][1]
    assert outsiders(run.looks, run.hosts, run.schedule.quiet_s) == []


# ---------------------------------------------------------------- the judge


def seen(text: str) -> bool:
    """Return whether the judge says *text* of one of the first schedules."""
    return any(text in wrong for number in range(12) for wrong in lost_reports(Watched(schedule(number))))


@pytest.mark.slow
def test_the_judge_misses_reports_that_a_host_does_not_take(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Host, "_learn", lambda *given: 0)
    assert seen("was reported to host")


@pytest.mark.slow
def test_the_judge_misses_what_hosts_do_not_tell_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    learn = Host._learn

    def of_searchers(host: Host, source: int, *heard: Any) -> int:
        return learn(host, source, *heard) if source >= host.setup.hosts else 0

    monkeypatch.setattr(Host, "_learn", of_searchers)
    assert seen("has not been told of")


HERE = frozenset({0, 1, 2})
"""Two hosts and searcher 2."""
ALL_HEAR = (HERE - {0}, HERE - {1}, HERE - {2})
NOBODY_HEARS = (frozenset[int](),) * 3


def looks(
    claims: list[tuple[int | None, int]],
    lists: dict[int, dict[int, int]],
    up: frozenset[int] = HERE,
    short: tuple[frozenset[int], ...] = ALL_HEAR,
    long: tuple[frozenset[int], ...] = ALL_HEAR,
) -> list[Look]:
    """Return what is seen 20 s to 42 s after the last fault; each second the searcher claims the next of *claims*."""
    return [
        Look(k / 2, up, (short, long), {2: claims[k // 2 % len(claims)]}, lists, {0: frozenset(), 1: frozenset()})
        for k in range(40, 84)
    ]


@pytest.mark.parametrize(
    ("seen", "wrong"),
    [
        (looks([(0, 7)], {0: {2: 7}, 1: {}}), ""),
        (looks([(1, 7)], {0: {}, 1: {2: 7}}), ""),
        (looks([(None, 7)], {0: {2: 7}, 1: {}}), "which does not live"),
        (looks([(0, 7)], {0: {2: 7}, 1: {}}, up=HERE - {0}), "which does not live"),
        (looks([(0, 7)], {0: {}, 1: {2: 7}}), "epoch 7: host 0 has it with epoch None"),
        (looks([(0, 7)], {0: {2: 6}, 1: {}}), "epoch 7: host 0 has it with epoch 6"),
        (looks([(0, 7)], {0: {2: 8}, 1: {}}), "epoch 7: host 0 has it with epoch 8"),
        (looks([(0, 7)], {0: {2: 7}, 1: {2: 6}}), "is in the list of host 1, too"),
        (looks([(0, 7), (1, 8)], {0: {2: 7}, 1: {2: 8}}), "joins on and on"),
    ],
)
def test_the_judge_sees_who_is_not_in_exactly_one_sub_team(seen: list[Look], wrong: str) -> None:
    said = outsiders(seen, hosts=2, quiet_s=0.0)
    assert [wrong in one for one in said] == ([True] if wrong else [])


@pytest.mark.parametrize(
    "seen",
    [
        looks([(0, 7)], {0: {2: 7}, 1: {2: 6}}, long=NOBODY_HEARS),
        looks([(0, 7)], {0: {2: 7}, 1: {2: 6}}, up=HERE - {1}),
        looks([(None, 7)], {0: {}, 1: {}}, short=NOBODY_HEARS),
        looks([(None, 7)], {0: {}, 1: {}}, up=HERE - {2}),
        looks([(None, 7)], {0: {}, 1: {}}, up=frozenset({2})),
    ],
    ids=["cut off", "dead lister", "out of reach", "dead searcher", "no host"],
)
def test_the_judge_asks_nobody_who_could_not_do_better(seen: list[Look]) -> None:
    assert outsiders(seen, hosts=2, quiet_s=0.0) == []


def test_the_judge_waits_for_a_new_membership_to_settle() -> None:
    old, new = looks([(0, 7)], {0: {2: 7}, 1: {}}), looks([(1, 8)], {0: {2: 7}, 1: {2: 8}})
    healed = looks([(1, 8)], {0: {}, 1: {2: 8}})
    changed = 19
    told = [*old[:changed], *new[changed : changed + 6], *healed[changed + 6 :]]
    assert outsiders(told, hosts=2, quiet_s=0.0) == []
    assert outsiders([*old[:changed], *new[changed:]], hosts=2, quiet_s=0.0) != []
