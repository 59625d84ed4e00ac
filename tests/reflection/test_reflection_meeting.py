"""Links on meeting: who looks for whom, and what follows from the device's answers."""

from cosim.machine import Connected, Discovered, Inquire, InquiryComplete, Lost, Page, PageFailed, Role, Scan
from cosim.units import S
from protocols.reflection.meeting import Meeting
from protocols.reflection.parameters import Parameters

PARAMETERS = Parameters(links=True, inquiry_s=5.0, page_s=6.0)


def meeting(me: int = 0, looks: bool = True) -> tuple[Meeting, list[object]]:
    out: list[object] = []
    return Meeting(me, looks, PARAMETERS, out), out  # type: ignore[arg-type]


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
