"""A piconet, with and without a takeover: whom its master pages and when, who succeeds it, and who hears whom."""

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
    LinkEvent,
    Lost,
    Page,
    PageFailed,
    Reception,
    Role,
    Scan,
)
from cosim.protocol import Surroundings
from cosim.units import MS, S, Time
from protocols.transport.links import Links, check_piconet, most_links, most_robots
from protocols.transport.parameters import LinkParameters, PagingParameters, TransportParameters
from tests.protocols.transport.transport_alone import TIMES

AROUND = Surroundings(
    ((0.0, 0.0),) * 4, 0.2, 0.5, 1.0, 100 * MS, np.zeros((0, 4)), (0, 0, 1, 1), lambda points: np.zeros(4, bool)
)


@pytest.mark.parametrize(
    ("links", "robots"), [((), 8), ((None,), 8), ((7,), 8), ((20, 3), 21), ((2,), 3), ((None, 2), 8)]
)
def test_a_piconet_has_a_master_and_as_many_slaves_as_the_radio_has_links(links: Any, robots: int) -> None:
    around = AROUND._replace(links=links)
    assert (most_robots(around), most_links(around)) == (robots, links[0] if links else None)
    if robots >= 4:
        check_piconet(around, "here")
        return
    with pytest.raises(UserError, match=r"^here: 4 robots, a piconet has at most 3$"):
        check_piconet(around, "here")


def test_each_radio_has_its_own_number_of_links() -> None:
    assert [most_robots(AROUND._replace(links=(7, 20, None)), radio) for radio in range(4)] == [8, 21, 8, 8]


both = pytest.mark.parametrize("takeover", [True, False])


def part(me: Address, size: int = 4, **changes: Any) -> Links:
    """Return the part of a robot that has said whether it scans."""
    links = Links(me, size, LinkParameters.model_validate({**TIMES, **changes}), 0)
    assert links.drain() == [Scan(enabled=changes.get("takeover", True) or me != 0)]
    return links


def told(links: Links, event: LinkEvent, now: Time = 0) -> list[LinkCommand]:
    """Return what it commands when it is told an event."""
    links.link(event, now)
    return links.drain()


def at(links: Links, now: Time, *seen: Address) -> list[LinkCommand]:
    """Return what a tick makes it command, at which its slaves are heard."""
    for slave in links.slaves:
        links.heard(slave, now)
    links.tick(seen, now)
    return links.drain()


def with_slaves(links: Links, *slaves: Address) -> Links:
    for slave in slaves:
        scans = [Scan(enabled=True)] if links._takeover else []
        assert told(links, Connected(slave, Role.MASTER)) == scans
    return links


def with_master(links: Links, master: Address = 0, now: Time = 0) -> Links:
    assert told(links, Connected(master, Role.SLAVE), now) == []
    return links


def pages_of_one_that_never_answers(links: Links, seconds: int, *seen: Address) -> list[int]:
    """Return the seconds in which it pages anybody."""
    times = []
    for second in range(seconds):
        for command in at(links, second * S, *seen):
            assert isinstance(command, Page)
            times.append(second)
            links.link(PageFailed(command.peer), second * S)
    return times


# ---------------------------------------------------------------- paging


@both
def test_the_first_in_order_leads_and_pages_all_one_after_the_other(takeover: bool) -> None:
    """It goes on scanning if another may be a master too, and find it."""
    links = part(0, takeover=takeover)
    for peer in (1, 2, 3):
        assert at(links, 0) == [Page(peer)]
        assert at(links, 0) == []
        assert told(links, Connected(peer, Role.MASTER)) == ([Scan(enabled=True)] if takeover else [])
    assert at(links, 100 * S) == []
    assert links.slaves == {1, 2, 3}


def test_another_may_be_the_first() -> None:
    links = part(2, first=2)
    assert at(links, 0) == [Page(0)]
    assert not any(part(me, first=2).leading for me in (0, 1, 3))


@both
def test_who_does_not_answer_is_paged_ever_more_rarely_and_if_near_often(takeover: bool) -> None:
    assert pages_of_one_that_never_answers(part(0, 2, takeover=takeover), 100) == [0, 10, 30, 50, 70, 90]
    assert pages_of_one_that_never_answers(part(0, 2, takeover=takeover), 21, 1) == [0, 5, 10, 15, 20]


def test_parameters_become_times() -> None:
    assert pages_of_one_that_never_answers(part(0, 2, page_s=1.0, page_most_s=3.0), 12) == [0, 2, 5, 8, 11]


@both
def test_of_those_who_are_due_those_are_paged_first_who_have_waited_longest(takeover: bool) -> None:
    links = part(0, takeover=takeover)
    order = []
    for second in (0, 1, 2, 30, 60, 90):
        (page,) = at(links, second * S, *() if second else (3,))
        assert isinstance(page, Page)
        order.append(page.peer)
        links.link(PageFailed(page.peer), second * S)
    assert order == [1, 2, 3, 1, 2, 3]


@both
def test_a_radio_that_does_not_answer_is_waited_for_only_so_long(takeover: bool) -> None:
    links = part(0, takeover=takeover)
    assert at(links, 0) == [Page(1)]
    assert at(links, 6 * S - 1) == []
    assert at(links, 6 * S) == [Page(2)]


@both
def test_the_end_of_another_page_ends_none(takeover: bool) -> None:
    links = part(0, takeover=takeover)
    assert at(links, 0) == [Page(1)]
    assert told(links, PageFailed(2)) == []
    assert at(links, S) == []
    with_slaves(links, 2)
    assert at(links, S) == []
    links.link(PageFailed(1), S)
    assert at(links, S) == [Page(3)]


@both
def test_who_was_lost_is_paged_again_after_the_shortest_time_and_then_more_rarely(takeover: bool) -> None:
    links = part(0, 2, takeover=takeover)
    pages_of_one_that_never_answers(links, 40)
    with_slaves(links, 1)
    assert told(links, Lost(1), 40 * S) == []
    assert links.slaves == set()
    assert at(links, 45 * S - 1) == []
    assert at(links, 45 * S) == [Page(1)]
    links.link(PageFailed(1), 50 * S)
    assert at(links, 60 * S - 1) == []
    assert at(links, 60 * S) == [Page(1)]


def test_the_dead_are_paged_last_and_rarely_until_they_are_linked_again() -> None:
    links = with_slaves(part(0, 5), 4)
    links.forget(1)
    order = []
    for second in (0, 1, 2):
        (page,) = at(links, second * S)
        assert isinstance(page, Page)
        order.append(page.peer)
        links.link(PageFailed(page.peer), second * S)
    assert order == [2, 3, 1]
    assert at(links, 10 * S) == [Page(2)]
    with_slaves(links, 2)
    assert at(links, 16 * S) == [Page(3)]
    with_slaves(links, 3)
    assert at(links, 21 * S) == []
    assert at(links, 22 * S) == [Page(1)]


def test_a_master_that_was_out_of_reach_of_all_pages_all_soon_once_it_finds_one() -> None:
    links = part(0, 3)
    assert pages_of_one_that_never_answers(links, 60)[-2:] == [50, 51]
    assert at(links, 60 * S) == []
    with_slaves(links, 1)
    assert at(links, 60 * S) == [Page(2)]


# ---------------------------------------------------------------- succession


def takes_over(links: Links, seconds: int = 200) -> int | None:
    """Return the second in which it begins to lead."""
    for second in range(seconds):
        links.tick((), second * S)
        if links.leading:
            return second
    return None


def test_before_anybody_was_there_robots_take_over_in_their_order() -> None:
    """First are those who have fewer before them: 0 is the first, then 1, 2 and 3."""
    assert [takes_over(part(me)) for me in range(4)] == [0, 18, 26, 34]
    assert [takes_over(part(me, first=3)) for me in range(4)] == [18, 26, 34, 0]


def test_a_master_that_is_lost_is_waited_for_no_more() -> None:
    for me, second in ((1, 10), (2, 18), (3, 26)):
        links = with_master(part(me))
        assert told(links, Lost(0)) == [Scan(enabled=True)]
        assert links.master is None
        assert takes_over(links) == second


def test_who_is_forgotten_is_waited_for_no_more() -> None:
    links = with_master(part(3))
    links.link(Lost(0), 0)
    links.forget(1)
    links.forget(2)
    assert takes_over(links) == 10


def test_nobody_takes_over_as_long_as_its_master_is_heard() -> None:
    links = with_master(part(1))
    for second in range(100):
        links.heard(0, second * S)
        links.heard(2, second * S)
        assert at(links, second * S) == []
    assert (links.leading, links.master) == (False, 0)


def test_a_master_that_is_silent_is_left() -> None:
    links = with_master(part(1))
    for second in range(15):
        links.heard(2, second * S)
        assert at(links, second * S) == []
    assert at(links, 15 * S) == [Disconnect(0), Scan(enabled=True)]
    assert told(links, Lost(0), 16 * S) == []  # that is known
    assert at(links, 25 * S - 1) == []
    assert at(links, 25 * S) == [Page(2)]  # its old master comes last
    assert links.leading


def test_a_slave_that_is_silent_is_left_and_paged_again() -> None:
    """A radio that was off has forgotten its links, and its robot was not told."""
    links = with_slaves(part(0, 3), 1, 2)
    for second in range(15):
        links.heard(2, second * S)
        links.tick((), second * S)
        assert links.drain() == []
    links.tick((), 15 * S)
    assert links.drain() == [Disconnect(1)]
    assert links.slaves == {2}
    assert at(links, 20 * S) == [Page(1)]


def test_who_is_found_before_it_takes_over_does_not() -> None:
    links = with_master(part(2))
    links.link(Lost(0), 0)
    at(links, 17 * S)
    assert with_master(links, 1, 17 * S).master == 1
    for second in range(17, 32):
        assert at(links, second * S) == []
    assert not links.leading


def test_a_successor_without_slaves_rests_between_pages_so_that_it_can_be_paged_itself() -> None:
    links = part(1)
    assert takes_over(links) == 18
    assert links.drain() == [Page(2)]
    links.link(PageFailed(2), 22 * S)
    assert at(links, 28 * S - 1) == []  # half as long again as the page was
    assert at(links, 28 * S) == [Page(3)]


def test_no_two_robots_rest_equally_long_lest_they_page_each_other_in_step() -> None:
    rests = []
    for me in range(4):
        links = with_slaves(part(me, 6, first=me), 4)
        links.forget(5)
        for other in range(4):
            links.forget(other) if other != me else None
        assert len(at(links, 0)) == 1
        page = links._paging
        assert page is not None
        links.link(PageFailed(page[0]), 4 * S)
        rests.append(next(second for second in range(4, 100) if at(links, second * S)))
    assert rests == [16, 18, 20, 22]


def test_who_takes_over_takes_those_before_it_for_dead_and_pages_them_last() -> None:
    links = part(2)
    takes_over(links)
    pages = links.drain()
    for peer in (3, 0, 1):
        pages += told(links, Connected(peer, Role.MASTER), 40 * S)[:-1] + at(links, 40 * S)
    assert pages == [Page(3), Page(0), Page(1)]


def test_after_a_page_in_vain_a_master_is_there_for_its_slaves_before_it_pages_anybody_who_may_be_dead() -> None:
    links = with_slaves(part(0, 5), 1)
    assert at(links, 0) == [Page(2)]
    links.link(PageFailed(2), 5 * S)
    assert at(links, 5 * S) == [Page(3)]  # nobody knows anything bad of it
    with_slaves(links, 3)
    links.forget(4)
    assert at(links, 20 * S - 1, 2, 4) == []
    assert at(links, 20 * S, 2, 4) == [Page(4)]
    links.link(PageFailed(4), 22 * S)
    assert at(links, 28 * S - 1, 2, 4) == []
    assert at(links, 28 * S, 2, 4) == [Page(2)]  # in turn


def test_who_was_lost_is_paged_at_once_although_another_was_paged_in_vain() -> None:
    links = with_slaves(part(0, 4), 1, 2)
    assert at(links, 0) == [Page(3)]
    links.link(Lost(2), 0)
    links.link(PageFailed(3), 5 * S)
    assert at(links, 5 * S) == [Page(2)]


# ---------------------------------------------------------------- without a takeover


def test_without_a_takeover_the_master_does_not_scan_and_the_others_do() -> None:
    parameters = LinkParameters(first=1, takeover=False)
    assert [Links(me, 3, parameters, 0).drain() for me in range(3)] == [[Scan(True)], [Scan(False)], [Scan(True)]]


def test_without_a_takeover_nobody_succeeds_a_master_that_is_dead_and_slaves_page_nobody() -> None:
    links = part(1, takeover=False)
    assert takes_over(links) is None
    with_master(links, 0, 200 * S)
    assert told(links, Lost(0), 300 * S) == [Scan(enabled=True)]
    links.forget(0)
    for second in range(300, 600):
        assert at(links, second * S, 0, 2) == []
    assert with_master(links, 0, 600 * S).master == 0


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
def test_without_a_takeover_all_links_but_those_of_the_first_to_the_others_are_closed(
    me: Address, event: Connected
) -> None:
    links = part(me, takeover=False)
    assert told(links, event) == [Disconnect(event.peer)]
    assert links.slaves == set()
    assert links.master is None


def test_without_a_longest_silence_links_last_until_the_radio_reports_their_loss() -> None:
    master, slave = with_slaves(part(0, 2, silence_s=None), 1), with_master(part(1, 2, silence_s=None))
    for links in (master, slave):
        links.tick((), 1000 * S)
        assert links.drain() == []
    assert (master.slaves, slave.master) == ({1}, 0)


# ---------------------------------------------------------------- two masters that find each other


def test_a_master_that_one_before_it_has_paged_gives_its_piconet_up() -> None:
    links = part(1)
    takes_over(links)
    links.drain()
    with_slaves(links, 2, 3)
    assert told(links, Connected(0, Role.SLAVE), 30 * S) == [Disconnect(2), Disconnect(3)]
    assert (links.leading, links.master, links.slaves, links.left) == (False, 0, set(), (2, 3))
    assert told(links, Lost(2), 30 * S) == told(links, Lost(3), 30 * S) == []
    assert at(links, 44 * S) == []


def test_a_master_that_one_behind_it_has_paged_pages_that() -> None:
    links = part(0)
    assert at(links, 0) == [Page(1)]
    links.link(PageFailed(1), 0)
    assert told(links, Connected(1, Role.SLAVE), S) == [Disconnect(1)]
    assert at(links, S) == [Page(1)]
    assert links.leading


def test_a_robot_without_a_master_follows_whoever_pages_it() -> None:
    links = part(1)
    assert with_master(links, 3).master == 3


@pytest.mark.parametrize(("other", "commands", "master"), [(1, [Disconnect(2)], 1), (3, [Disconnect(3)], 2)])
def test_a_slave_changes_masters_only_for_one_before_its_own(
    other: Address, commands: list[LinkCommand], master: Address
) -> None:
    links = with_master(part(0, first=1), 2)
    assert told(links, Connected(other, Role.SLAVE)) == commands
    assert links.master == master


@pytest.mark.parametrize(
    ("me", "event"),
    [
        (0, Connected(4, Role.MASTER)),
        (1, Connected(2, Role.MASTER)),  # it does not lead
        (1, Connected(4, Role.SLAVE)),
        (1, Connected(2, Role.PEER)),
    ],
)
def test_links_that_belong_to_no_such_piconet_are_closed(me: Address, event: Connected) -> None:
    links = part(me)
    assert told(links, event) == [Disconnect(event.peer)]
    assert links.slaves == set()
    assert links.master is None


def test_a_page_that_succeeds_when_its_robot_has_found_a_master_is_undone() -> None:
    links = part(1)
    takes_over(links)
    assert links.drain() == [Page(2)]
    with_master(links)
    assert told(links, Connected(2, Role.MASTER)) == [Disconnect(2)]


def test_a_master_talks_to_its_slaves_and_they_to_all_by_way_of_it() -> None:
    first, second = part(0), part(2)
    assert first.audience is second.audience is first.hop(1) is second.hop(1) is None
    with_slaves(first, 2)
    with_master(second)
    assert (first.audience, first.hop(2), first.hop(1)) == (BROADCAST, 2, None)
    assert (second.audience, second.hop(0), second.hop(1)) == (0, 0, 0)
    second.link(Lost(0), 0)
    assert second.audience is None


def test_a_master_relays_what_a_slave_has_sent_to_it_alone_if_there_are_others() -> None:
    links = with_slaves(part(0), 1)
    assert not links.relays(1, Reception(1, False))
    with_slaves(links, 2)
    assert links.relays(1, Reception(1, False))
    assert not links.relays(1, Reception(1, True))
    assert not links.relays(1, Reception(2, False))  # another has relayed it
    assert not with_master(part(2)).relays(1, Reception(1, False))


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"page_s": 61.0}, r"page_s\n  is not <= 60\.0, page_most_s"),
        ({"beat_s": 15.0}, r"silence_s\n  is not > 15\.0, beat_s"),
    ],
)
def test_times_that_contradict_each_other_are_refused(changes: dict[str, float], why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        LinkParameters.model_validate(changes)


def test_the_times_of_pages_are_checked_where_nothing_else_is_set() -> None:
    with pytest.raises(ValidationError, match=r"page_s\n  is not <= 1\.0, page_most_s"):
        PagingParameters(page_s=2.0, page_most_s=1.0)


def test_slaves_may_be_left_no_time_between_two_pages_in_vain() -> None:
    links = with_slaves(part(0, 4, service=0), 1)
    for second, peer in ((0, 2), (5, 3), (10, 2), (15, 3)):
        assert at(links, second * S, 2, 3) == [Page(peer)]
        links.link(PageFailed(peer), (second + 5) * S)


def test_heartbeats_may_be_as_rare_as_wanted_where_no_silence_ends_a_link() -> None:
    assert LinkParameters(beat_s=100.0, silence_s=None).silence_s is None


def test_waits_that_do_not_grow_are_refused() -> None:
    with pytest.raises(ValidationError, match=r"retry_s\n  is not >= 0\.2, retry_least_s, and <= 4\.0, retry_most_s"):
        TransportParameters(retry_s=0.1)
