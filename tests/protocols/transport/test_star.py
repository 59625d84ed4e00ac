"""A piconet kept by robot 0: whom it pages and when, who hears whom, and maps that are merged over it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.errors import UserError
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    LinkCommand,
    Lost,
    Outgoing,
    Page,
    PageFailed,
    Reception,
    Role,
    Scan,
)
from cosim.observation import Observation, Sighting
from cosim.scenario import build
from cosim.simulation import Simulation
from cosim.testing import check_machine
from cosim.units import MS, S, Time
from protocols.mapping.frames import Summary, encode
from protocols.mapping.sharing import Sharing, SharingCounters, SharingParameters
from protocols.transport.star import Piconet, PiconetParameters
from tests.protocols.exploration.test_laws import STARTS_M, maker
from tests.protocols.mapping.sharing_scene import OCCUPIED, UNKNOWN, Team
from tests.protocols.mapping.test_sharing import wander

HERE = (0.0, 0.0)
FAR = (9.0, 0.0)
TIMES = PiconetParameters(patience_s=6.0, page_s=5.0, page_most_s=20.0)


def master(size: int = 4) -> Piconet:
    """Return a master that has said that it does not scan: 6 s of patience, waits from 5 to 20 s."""
    piconet = Piconet(0, size, TIMES)
    piconet.drain()
    return piconet


def slave(me: Address = 2) -> Piconet:
    piconet = Piconet(me, 4, TIMES)
    piconet.drain()
    return piconet


def linked(piconet: Piconet, *peers: Address) -> Piconet:
    for peer in peers:
        piconet.link(Connected(peer, Role.SLAVE if peer == 0 else Role.MASTER), 0)
    return piconet


def at(piconet: Piconet, now: Time, **told: Any) -> list[LinkCommand]:
    """Return what a tick makes it command."""
    piconet.tick(HERE, told.get("places_m", {}), told.get("seen", ()), now)
    return piconet.drain()


def pages_of_one_that_never_answers(piconet: Piconet, seconds: int, **told: Any) -> list[int]:
    """Return the seconds in which robot 1, which is out of reach, is paged."""
    times = []
    for second in range(seconds):
        if at(piconet, second * S, **told) == [Page(1)]:
            times.append(second)
            piconet.link(PageFailed(1), second * S)
    return times


# ---------------------------------------------------------------- paging


def test_the_master_does_not_scan_and_the_others_do() -> None:
    assert [Piconet(me, 3, TIMES).drain() for me in range(3)] == [[Scan(False)], [Scan(True)], [Scan(True)]]


def test_the_master_pages_all_one_after_the_other_and_nobody_twice() -> None:
    piconet = master()
    for peer in (1, 2, 3):
        assert at(piconet, 0) == [Page(peer)]
        assert at(piconet, 0) == []
        linked(piconet, peer)
    assert at(piconet, 100 * S) == []
    assert piconet.linked == {1, 2, 3}


def test_slaves_page_nobody() -> None:
    assert at(slave(), 0, seen=(0, 1)) == []


def test_who_does_not_answer_is_paged_ever_more_rarely() -> None:
    assert pages_of_one_that_never_answers(master(2), 100) == [0, 10, 30, 50, 70, 90]


def test_who_is_in_sight_is_paged_after_the_shortest_time() -> None:
    assert pages_of_one_that_never_answers(master(2), 21, seen=(1,)) == [0, 5, 10, 15, 20]


@pytest.mark.parametrize(("heard_m", "times"), [(18.0, [0, 5, 10, 15, 20]), (17.9, [0, 10])])
def test_who_was_heard_from_less_than_half_of_the_reach_is_likely_to_be_near(heard_m: float, times: list[int]) -> None:
    piconet = master(2)
    piconet.heard(heard_m)
    piconet.heard(1.0)
    assert pages_of_one_that_never_answers(piconet, 21, places_m={1: FAR}) == times


def test_of_those_who_are_due_those_are_paged_first_who_have_waited_longest() -> None:
    piconet = master(4)
    order = []
    for second in (0, 1, 2, 30, 60, 90):
        (page,) = at(piconet, second * S, seen=() if second else (3,))
        assert isinstance(page, Page)
        order.append(page.peer)
        piconet.link(PageFailed(page.peer), second * S)
    assert order == [1, 2, 3, 1, 2, 3]


def test_who_was_lost_is_paged_again_after_the_shortest_time_and_then_more_rarely() -> None:
    piconet = master(2)
    pages_of_one_that_never_answers(piconet, 40)
    linked(piconet, 1)
    piconet.link(Lost(1), 40 * S)
    assert piconet.linked == set()
    assert at(piconet, 45 * S - 1) == []
    assert at(piconet, 45 * S) == [Page(1)]
    piconet.link(PageFailed(1), 50 * S)
    assert at(piconet, 60 * S - 1) == []
    assert at(piconet, 60 * S) == [Page(1)]


def test_a_radio_that_does_not_answer_is_waited_for_only_so_long() -> None:
    piconet = master(3)
    assert at(piconet, 0) == [Page(1)]
    assert at(piconet, 6 * S - 1) == []
    assert at(piconet, 6 * S) == [Page(2)]


def test_the_end_of_another_page_ends_none() -> None:
    piconet = master(4)
    assert at(piconet, 0) == [Page(1)]
    piconet.link(PageFailed(2), 0)
    assert at(piconet, S) == []
    linked(piconet, 2)
    assert at(piconet, S) == []
    piconet.link(PageFailed(1), S)
    assert at(piconet, S) == [Page(3)]


def test_a_clock_that_is_set_back_stops_no_paging() -> None:
    piconet = master(2)
    at(piconet, 1000 * S)
    piconet.link(PageFailed(1), 1000 * S)
    assert at(piconet, 10 * S) == [Page(1)]
    assert at(piconet, 5 * S) == []  # that page is given up
    assert at(piconet, 25 * S) == [Page(1)]


@pytest.mark.parametrize(
    ("me", "event"),
    [
        (0, Connected(1, Role.SLAVE)),
        (2, Connected(0, Role.MASTER)),
        (2, Connected(1, Role.SLAVE)),
        (2, Connected(1, Role.MASTER)),
        (0, Connected(4, Role.MASTER)),
    ],
)
def test_links_that_belong_to_no_such_piconet_are_closed(me: Address, event: Connected) -> None:
    piconet = master() if me == 0 else slave(me)
    piconet.link(event, 0)
    assert piconet.drain() == [Disconnect(event.peer)]
    assert piconet.linked == set()


# ---------------------------------------------------------------- who hears whom


def test_the_master_talks_to_all_and_slaves_to_the_master_as_long_as_there_is_a_link() -> None:
    first, second = master(), slave()
    assert first.audience is second.audience is None
    assert linked(first, 2).audience == BROADCAST
    assert linked(second, 0).audience == 0
    second.link(Lost(0), 0)
    assert second.audience is None


def test_the_master_says_again_what_a_slave_has_said_if_there_are_others() -> None:
    piconet = linked(master(), 1)
    assert not piconet.relays(1, Reception(1, False))
    linked(piconet, 2)
    assert piconet.relays(1, Reception(1, False))
    assert not piconet.relays(1, Reception(1, True))
    assert not piconet.relays(1, Reception(2, False))  # 2 has heard it from somebody
    assert not linked(slave(), 0).relays(1, Reception(1, False))


@pytest.mark.parametrize("near", ["seen", "heard near", "heard far", "nothing"])
def test_who_shares_pages_those_soon_who_were_seen_or_heard_near_by(near: str) -> None:
    links = PiconetParameters(patience_s=6.0, page_s=5.0, page_most_s=20.0)
    sharing = Sharing(SharingParameters(octets=60, links=links), 0, 2, 400, SharingCounters(), 0)
    sharing.tick(0.0, 0.0, 0)
    assert Page(1) in sharing.drain()
    for away_m in {"heard near": (18.0, 9.0), "heard far": (9.0, 18.0)}.get(near, ()):
        sharing.receive(encode(1, Summary(away_m, 0.0, ())), Reception(1, False), 0)
    sharing.link(PageFailed(1), 0)
    sharing.tick(0.0, 0.0, 5 * S, [Sighting(1, 1.0, 1.0)] if near == "seen" else [])
    assert (Page(1) in sharing.drain()) == (near in ("seen", "heard near"))


def test_slaves_that_are_never_in_reach_of_each_other_have_the_same_map_at_once() -> None:
    team = Team(4, links=True)
    team.reach = lambda teller, hearer: 0 in (teller, hearer)
    team.pass_periods(1)
    whole = wander(team, 4)
    team.pass_periods(1)
    assert team.agree
    assert (team.maps[3] == whole).all()
    assert team.count("pieces_again") == 0
    assert {other for other, *_ in team.robots[3].places(team.now)} == {0, 1, 2}


def test_a_slave_asks_the_master_rather_than_another_slave() -> None:
    team = Team(4, links=True)
    team.pass_periods(1)
    team.reach = lambda teller, hearer: 3 not in (teller, hearer)
    wander(team, 3)
    team.reach = lambda teller, hearer: True
    before = [counters.pieces_again for counters in team.counters]
    team.pass_periods(8)
    assert team.agree
    again = [counters.pieces_again - had for counters, had in zip(team.counters, before, strict=True)]
    assert again[0] > 0 < again[3]  # that is asked by the master for what only it has
    assert again[1] == again[2] == 0


def test_all_that_is_sent_is_counted_once_and_nothing_without_a_link() -> None:
    team = Team(3, links=True)
    team.reach = lambda teller, hearer: False
    wander(team, 2)
    assert team.frames == []
    assert team.count("frames") == team.count("payload_bytes") == 0
    team.reach = lambda teller, hearer: True
    team.pass_periods(4)
    assert team.count("frames") == len(team.frames) > 0
    assert team.count("payload_bytes") == sum(len(data) for _, data in team.frames)


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_who_was_lost_gets_what_it_has_missed_and_tells_what_it_has_seen(loss: float) -> None:
    team = Team(4, links=True, loss=loss)
    wander(team, 2)
    team.reach = lambda teller, hearer: 3 not in (teller, hearer)
    wander(team, 6, seed=2)
    assert team.maps[3].tolist() != team.maps[0].tolist()
    team.reach = lambda teller, hearer: True
    pages = len(team.pages)
    team.pass_periods(25)
    assert team.agree
    assert team.pages[pages:] == [3]


def test_a_master_that_boots_again_gets_its_map_back() -> None:
    team = Team(3, links=True)
    wander(team, 3)
    team.boot(0)
    team.pass_periods(10)
    assert team.agree
    assert (team.maps[0] == OCCUPIED).sum() > 20


# ---------------------------------------------------------------- in a team of explorers


def test_parameters_become_times() -> None:
    piconet = Piconet(0, 2, PiconetParameters(patience_s=6.0, page_s=1.0, page_most_s=3.0))
    piconet.drain()
    assert pages_of_one_that_never_answers(piconet, 12) == [0, 2, 5, 8, 11]
    with pytest.raises(ValidationError, match=r"page_s\n  is not <= 1\.0, page_most_s"):
        PiconetParameters(page_s=2.0, page_most_s=1.0)


def test_an_explorer_talks_over_its_links_and_remembers_whom_it_has_seen() -> None:
    machine: Any = maker(wheels=False, map="messages", sharing={"links": {}})(0, 0)
    seen = Observation(0.6, 0.6, 0.0, 0.0, True, False, (1,), (Sighting(1, 1.2, 0.6),))
    machine.observe(seen, 0)
    assert machine.outbox() == [Scan(False), Page(1)]
    machine.link(Connected(1, Role.MASTER), 0)
    machine.observe(Observation(0.6, 0.6, 0.0, 0.0, True, False), S)
    assert [item.destination for item in machine.outbox() if isinstance(item, Outgoing)] == [BROADCAST]
    assert machine._bodies(Observation(0.6, 0.6, 0.0, 0.0, True, False), S).tolist() == [[1.2, 0.6, 0.2 + 0.3]]


@pytest.mark.slow
def test_explorers_that_keep_links_keep_the_laws() -> None:
    check_machine(maker(map="messages", sharing={"links": {}}), STARTS_M, 2500 * MS)


def scenario(size: int, channel: dict[str, Any], duration_s: float) -> dict[str, Any]:
    return {
        "duration_s": duration_s,
        "floorplan": {"map": "office", "office": {"width_m": 8, "depth_m": 6, "rooms": 2}},
        "team": {
            "size": size,
            "senses": {"beams": 360, "beam_range_m": 2.5},
            "body": {"radius_m": 0.2, "speed_mps": 0.3, "drive": "differential"},
        },
        "channel": channel,
        "protocol": {
            "use": "protocols.exploration.spec:SPEC",
            "parameters": {"map": "messages", "sharing": {"links": {}}},
        },
    }


def roomy(size: int, channel: dict[str, Any], duration_s: float) -> dict[str, Any]:
    data = scenario(size, channel, duration_s)
    data["floorplan"]["office"] = {"width_m": 16, "depth_m": 10, "rooms": 2}
    return data


def test_a_team_that_is_too_large_for_a_piconet_is_refused() -> None:
    with pytest.raises(UserError, match=r"sharing\.links: 9 robots, a piconet has at most 8"):
        Simulation(build(roomy(9, {"kind": "ideal"}, 1.0), "test", Path()), 1)


@pytest.mark.slow
@pytest.mark.parametrize("range_m", [None, 4.0])
def test_robots_that_explore_over_bluetooth_end_with_the_same_map(range_m: float | None) -> None:
    """Also if they are out of robot 0's reach for a while; and every packet's fate is to be received."""
    channel = {"kind": "bluetooth", "range_m": range_m, "supervision_s": 5.0}
    run = Simulation(build(scenario(3, channel, 400.0), "test", Path()), 1)
    outcome = run.run()
    machines: list[Any] = run.machines
    maps = [np.sign(machine.belief.evidence) for machine in machines]
    assert outcome.metrics["coverage"] > 0.99
    assert outcome.metrics["frames_dm3"] > 100
    assert (maps[0] != UNKNOWN).sum() > 1000
    assert all((each == maps[0]).all() for each in maps)
    assert len(machines[0].sharing.ledger.counts) == 3


@pytest.mark.slow
def test_summaries_of_a_full_piconet_fit_its_packets() -> None:
    """Eight robots: after some seconds each knows of pieces of all others."""
    run = Simulation(build(roomy(8, {"kind": "bluetooth"}, 40.0), "test", Path()), 1)
    run.run()
    machines: list[Any] = run.machines
    counts = [machine.sharing.ledger.counts.values() for machine in machines]
    assert [sum(count > 2 for count in each) for each in counts] == [8] * 8
    assert machines[0].sharing._piconet.linked == set(range(1, 8))
