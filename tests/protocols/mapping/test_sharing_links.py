"""Maps that are merged over the links of a piconet: whom its master pages soon, who hears whom, and who is asked."""

import pytest

from cosim.machine import Connected, Disconnect, Page, PageFailed, Reception, Role
from cosim.observation import Sighting
from cosim.units import S
from protocols.mapping.frames import Summary, encode
from protocols.mapping.sharing import Sharing, SharingCounters, SharingParameters
from protocols.transport.parameters import PagingParameters
from tests.protocols.mapping.sharing_scene import OCCUPIED, Team
from tests.protocols.mapping.test_sharing import wander


def over_links(me: int = 0, size: int = 2) -> Sharing:
    """Return a robot that waits 5 to 20 s from one page in vain to the next."""
    links = PagingParameters(patience_s=6.0, page_s=5.0, page_most_s=20.0)
    return Sharing(SharingParameters(octets=60, links=links), me, size, 400, SharingCounters(), 0)


@pytest.mark.parametrize(
    ("heard_m", "seen", "soon"),
    [
        ((), False, False),
        ((), True, True),
        ((18.0, 9.0), False, True),  # at no more than half of the greatest distance
        ((17.9, 9.0), False, False),
        ((9.0, 18.0), False, False),
    ],
)
def test_those_are_paged_soon_who_were_seen_or_heard_near_by(
    heard_m: tuple[float, ...], seen: bool, soon: bool
) -> None:
    sharing = over_links()
    sharing.tick(0.0, 0.0, 0)
    assert Page(1) in sharing.drain()
    for away_m in heard_m:
        sharing.receive(encode(1, Summary(away_m, 0.0, ())), Reception(1, False), 0)
    sharing.link(PageFailed(1), 0)
    sharing.tick(0.0, 0.0, 5 * S, [Sighting(1, 1.0, 1.0)] if seen else [])
    assert (Page(1) in sharing.drain()) == soon


def test_a_page_in_vain_is_followed_by_the_next_at_once_and_silence_ends_no_link() -> None:
    sharing = over_links(size=3)
    sharing.link(Connected(1, Role.MASTER), 0)
    paged = []
    for second in range(0, 60, 5):
        sharing.tick(0.0, 0.0, second * S, [Sighting(2, 1.0, 1.0)])
        sent = sharing.drain()
        paged.append(Page(2) in sent)
        assert Disconnect(1) not in sent
        sharing.link(PageFailed(2), (second + 5) * S)
    assert paged == [True, False] * 6  # 5 s for the page and 5 s to the next


def test_a_clock_that_is_set_back_delays_pages_by_no_more_than_that_tick() -> None:
    sharing = over_links()
    sharing.tick(0.0, 0.0, 1000 * S)
    assert Page(1) in sharing.drain()
    sharing.link(PageFailed(1), 1000 * S)
    pages = []
    for second in range(40):
        sharing.tick(0.0, 0.0, second * S)
        if Page(1) in sharing.drain():
            pages.append(second)
    assert pages == [10, 36]  # that of 10 s is given up after 6 s, and the wait is 20 s by then


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
