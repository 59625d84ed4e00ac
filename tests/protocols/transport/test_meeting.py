"""Links on meeting: who looks for whom, and what follows from the device's answers."""

import pytest

from cosim.machine import Connected, Discovered, Inquire, InquiryComplete, Lost, Page, PageFailed, Role, Scan
from cosim.units import S
from protocols.transport.meeting import Meeting

INQUIRY, PATIENCE = 5 * S, 6 * S


def meeting(me: int = 0, looks: bool = True, **more: int) -> tuple[Meeting, list[object]]:
    out: list[object] = []
    return Meeting(me, looks, INQUIRY, PATIENCE, out, **more), out  # type: ignore[arg-type]


def taken(out: list[object]) -> list[object]:
    found = out[:]
    out.clear()
    return found


def test_an_explorer_looks_for_whom_it_sees_pages_whom_it_finds_and_looks_again_for_the_others() -> None:
    room, out = meeting()
    room.look([], 0)
    assert taken(out) == []
    room.look([1, 2], S)
    assert taken(out) == [Scan(False), Inquire(5 * S, 2)]
    room.look([1, 2], 2 * S)
    assert taken(out) == []
    room.link(Discovered(2), 3 * S)
    room.link(InquiryComplete((2,)), 6 * S)
    assert taken(out) == [Page(2)]
    room.link(Connected(2, Role.MASTER), 7 * S)
    assert (room.linked, taken(out)) == ({2}, [])
    room.look([1, 2], 8 * S)
    assert taken(out) == [Scan(False), Inquire(5 * S, 1)]


def test_what_fails_is_tried_again_and_a_silent_device_is_not_waited_for() -> None:
    room, out = meeting()
    room.look([1], 0)
    room.link(Discovered(1), S)
    room.link(InquiryComplete((1,)), S)
    taken(out)
    room.link(PageFailed(1), 2 * S)
    assert taken(out) == [Scan(True)]
    room.look([1], 3 * S)
    assert taken(out)[-1] == Inquire(5 * S, 1)
    room.look([1], 13 * S)
    assert taken(out) == []
    room.look([1], 14 * S)
    assert taken(out)[-1] == Inquire(5 * S, 1)


def test_helpers_and_slaves_look_for_nobody() -> None:
    room, out = meeting(looks=False)
    room.look([1, 2], 0)
    assert taken(out) == []
    room, out = meeting()
    room.link(Connected(5, Role.SLAVE), 0)
    assert taken(out) == [Scan(False)]
    room.look([1, 2], S)
    assert taken(out) == []
    room.link(Lost(5), 2 * S)
    assert taken(out) == [Scan(True)]
    room.look([1, 2], 3 * S)
    assert taken(out)[-1] == Inquire(5 * S, 2)


def test_robots_of_lower_numbers_are_left_to_look_themselves() -> None:
    room, out = meeting(me=5)
    room.look([1, 2], 0)
    assert taken(out) == []
    room.look([1, 7], S)
    assert taken(out) == [Scan(False), Inquire(5 * S, 1)]


@pytest.mark.parametrize(("last", "more"), [(7, {}), (2, {"most": 3}), (20, {"most": 21})])
def test_a_master_of_seven_or_as_many_as_its_radio_has_links_for_looks_for_nobody_and_pages_nobody(
    last: int, more: dict[str, int]
) -> None:
    room, out = meeting(**more)
    room.look([last, last + 1], 0)
    for peer in range(1, last):
        room.linked.add(peer)
    room.link(Discovered(last), S)
    room.link(Discovered(last + 1), S)
    room.link(InquiryComplete((last, last + 1)), S)
    assert taken(out)[-1] == Page(last)
    room.link(Connected(last, Role.MASTER), 2 * S)
    room.look([last + 1], 30 * S)
    assert taken(out) == []


def test_who_is_found_twice_is_paged_once_and_who_is_linked_or_oneself_never() -> None:
    room, out = meeting()
    room.linked.add(2)
    room.look([1, 2], 0)
    taken(out)
    for peer in (2, 0, 1, 1):
        room.link(Discovered(peer), S)
    room.link(InquiryComplete((2, 0, 1)), S)
    assert taken(out) == [Page(1)]
    room.link(PageFailed(1), 2 * S)
    assert taken(out) == []


def test_who_becomes_a_slave_in_an_inquiry_pages_nobody_after_it_and_looks_at_once_when_it_is_free() -> None:
    room, out = meeting()
    room.look([1], 0)
    room.link(Discovered(1), S)
    room.link(Connected(9, Role.SLAVE), 2 * S)
    taken(out)
    room.link(InquiryComplete((1,)), 3 * S)
    assert taken(out) == []
    room.link(Lost(9), 4 * S)
    room.look([1], 4 * S)
    assert taken(out) == [Scan(True), Scan(False), Inquire(5 * S, 1)]


def test_a_link_that_is_lost_in_an_inquiry_does_not_make_the_device_scan() -> None:
    room, out = meeting()
    room.link(Connected(2, Role.MASTER), 0)
    room.look([1], S)
    taken(out)
    room.link(Lost(2), 2 * S)
    assert taken(out) == []


def test_a_page_is_waited_for_as_long_as_the_parameters_have_it_and_what_it_says_later_is_no_news() -> None:
    room, out = meeting()
    room.look([1, 3], 0)
    room.link(Discovered(1), S)
    room.link(Discovered(3), S)
    room.link(InquiryComplete((1, 3)), 10 * S)
    taken(out)
    room.look([1, 3], 12 * S)
    assert taken(out) == []
    room.look([], 16 * S)
    assert taken(out) == [Scan(True)]
    room.link(PageFailed(1), 17 * S)
    assert taken(out) == []
    room.look([3], 18 * S)
    taken(out)
    room.link(InquiryComplete(()), 23 * S)  # nobody was found this time
    assert taken(out) == [Scan(True)]
