"""Transports over the channels of cosim: plans arrive, over several hops too, and when the master of a piconet dies."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.protocols.transport.transport_toy import payload_of, run
from tests.tiers import soak_count

PLAN = 18_000
POSTS = [(10.0, 0, 1, PLAN), (12.0, 0, 3, PLAN), (20.0, 3, 2, 5000), (20.0, 2, 0, 300), (20.0, 1, 0, 0)]
BLUETOOTH = {"kind": "bluetooth", "supervision_s": 8.0}
"""A page in vain lasts 5.12 s, for which the piconet is suspended: links have to last longer than that."""
LINKS: dict[str, Any] = {"links": {}}

pytestmark = pytest.mark.slow


def all_arrived(machines: Sequence[Any], posts: Sequence[tuple[float, int, int, int]], within_s: float) -> bool:
    """Return whether each message has arrived once, whole, so soon."""
    for number, (at_s, author, to, octets) in enumerate(posts):
        payload = payload_of(number, octets)
        times = [at for at, source, got in machines[to].got if (source, got) == (author, payload)]
        if len(times) != 1 or not at_s <= times[0] <= at_s + within_s:
            return False
    return sum(len(machine.got) for machine in machines) == len(posts)


def test_all_arrives_over_an_ideal_channel_that_loses_and_delays() -> None:
    machines = run(4, {"kind": "ideal", "loss": 0.1, "jitter_s": 0.05}, 30.0, POSTS)
    assert all_arrived(machines, POSTS, 8.0)
    assert sum(machine.transport.counts.parts_again for machine in machines) > 20
    assert all(len(times) > 45 for machine in machines for times in machine.news_of.values())


def test_all_arrives_over_one_hop_of_an_ad_hoc_network() -> None:
    machines = run(4, {"kind": "adhoc"}, 30.0, POSTS, transport={"octets": 1400})
    assert all_arrived(machines, POSTS, 1.0)
    assert all(len(times) >= 58 for machine in machines for times in machine.news_of.values())


def test_all_arrives_over_three_hops_and_flooded_news_too() -> None:
    """Robots of which each reaches its neighbours only, without which news would come over one hop."""
    channel = {"kind": "adhoc", "range_m": 3.0, "routing": {"kind": "aodv"}}
    machines = run(4, channel, 30.0, POSTS, transport={"octets": 1400, "flood": True, "spread_s": 0.2})
    assert all_arrived(machines, POSTS, 5.0)
    assert len(machines[0].news_of[3]) > 30
    assert len(machines[3].news_of[0]) > 30


def test_all_arrives_in_a_piconet_between_slaves_too() -> None:
    machines = run(4, BLUETOOTH, 30.0, POSTS, transport=LINKS)
    assert all_arrived(machines, POSTS, 5.0)
    assert machines[0].transport.links.slaves == {1, 2, 3}
    assert all(len(machine.news_of) == 3 for machine in machines)
    assert sum(machine.transport.counts.parts_again for machine in machines) < 20


def test_a_full_piconet_carries_a_plan_to_all() -> None:
    posts = [(30.0, 0, to, PLAN) for to in range(1, 8)]
    machines = run(8, BLUETOOTH, 45.0, posts, transport=LINKS)
    assert all_arrived(machines, posts, 10.0)


def test_a_piconet_of_ten_carries_messages_between_all_over_low_energy() -> None:
    posts = [(10.0, robot, (robot + 3) % 10, 2000) for robot in range(10)]
    channel = {"kind": "ble", "connection": {"links": 12, "interval_s": 0.03}}
    machines = run(10, channel, 30.0, posts, transport=LINKS)
    assert all_arrived(machines, posts, 15.0)
    assert one_piconet(machines, range(10), 0)
    assert all(len(machine.news_of) == 9 for machine in machines)


def one_piconet(machines: Sequence[Any], living: Sequence[int], master: int) -> bool:
    """Return whether the living are linked to *master*, and it to them."""
    slaves = set(living) - {master}
    links = machines[master].transport.links
    follow = all(machines[slave].transport.links.master == master for slave in slaves)
    return follow and links.leading and links.slaves == slaves


@pytest.mark.parametrize("dead", [(0,), (0, 1), (0, 2), (1, 2)])
def test_when_masters_die_the_first_who_lives_takes_over(dead: tuple[int, ...]) -> None:
    faults = [{"kind": "kill", "robot": robot, "at_s": 20.0} for robot in dead]
    living = [robot for robot in range(5) if robot not in dead]
    posts = [(66.0, living[-1], living[0], PLAN), (66.0, living[1], living[-1], 5000)]
    machines = run(5, BLUETOOTH, 85.0, posts, transport=LINKS, faults=faults)
    assert one_piconet(machines, living, living[0])
    assert all_arrived(machines, posts, 10.0)


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "crash", "robot": 0, "at_s": 20.0, "for_s": 9.0},
        {"kind": "crash", "robot": 0, "at_s": 20.0, "for_s": 50.0},
        {"kind": "radio_off", "robot": 0, "at_s": 20.0, "for_s": 50.0},
        {"kind": "radio_off", "robot": 2, "at_s": 20.0, "for_s": 50.0},
        {"kind": "crash", "robot": 3, "at_s": 20.0, "for_s": 5.0},
    ],
)
def test_who_comes_back_is_in_one_piconet_with_all_in_the_end(fault: dict[str, Any]) -> None:
    posts = [(130.0, 1, 2, PLAN), (130.0, 2, 1, 100)]
    machines = run(4, BLUETOOTH, 145.0, posts, transport=LINKS, faults=[fault])
    assert one_piconet(machines, range(4), 0)
    assert all(payload_of(0, PLAN) in [got for _, _, got in machine.got] for machine in machines[2:3])
    assert all(machine.back == [] for machine in machines)


def test_a_message_that_is_on_its_way_when_the_master_dies_arrives_by_way_of_the_next() -> None:
    faults = [{"kind": "kill", "robot": 0, "at_s": 20.2}]
    posts = [(20.0, 2, 3, PLAN)]
    machines = run(4, BLUETOOTH, 70.0, posts, transport=LINKS, faults=faults)
    assert all_arrived(machines, posts, 40.0)
    assert machines[3].got[0][0] > 25.0  # not before the loss is noticed


@pytest.mark.soak
def test_after_any_faults_the_living_are_in_one_piconet(record_property: Any) -> None:
    """Crashes, radios that are off and deaths within 100 s; two minutes later messages go from all to all."""
    cases = soak_count(40)
    for case in range(cases):
        luck = np.random.default_rng(case)
        size = int(luck.integers(3, 9))
        faults = []
        for robot in luck.choice(size, luck.integers(1, min(5, size - 1)), replace=False).tolist():
            fault: dict[str, Any] = {"robot": robot, "at_s": float(luck.uniform(5.0, 70.0))}
            kind = str(luck.choice(["kill", "crash", "radio_off"]))
            lasts = {} if kind == "kill" else {"for_s": float(luck.uniform(1.0, 30.0))}
            faults.append(fault | {"kind": kind} | lasts)
        dead = {fault["robot"] for fault in faults if fault["kind"] == "kill"}
        living = [robot for robot in range(size) if robot not in dead]
        posts = [(220.0, one, other, 1000) for one in living for other in living if one != other]
        machines = run(size, BLUETOOTH, 260.0, posts, transport=LINKS, faults=faults, seed=case)
        assert one_piconet(machines, living, living[0]), (case, faults)
        for number, (_, _, to, octets) in enumerate(posts):
            assert [got for _, _, got in machines[to].got].count(payload_of(number, octets)) >= 1, (case, faults)
    record_property("piconets with faults", cases)
