"""The ideal channel answers commands that only a radio's link needs: by an event, at the same instant."""

import pytest

from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.kernel import Kernel
from cosim.machine import (
    Address,
    Hold,
    LinkCommand,
    LinkEvent,
    Mode,
    ModeChanged,
    Page,
    Park,
    Reception,
    Role,
    RoleChanged,
    Sniff,
    SwitchRole,
    Unpark,
)
from cosim.trace import Trace
from cosim.units import Time


class Host:
    """An endpoint that notes link events."""

    def __init__(self) -> None:
        self.events: list[tuple[Time, LinkEvent]] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        raise AssertionError("nothing was sent")

    def link(self, event: LinkEvent, now: Time) -> None:
        self.events.append((now, event))

    def drain(self, now: Time) -> None:
        pass


def answers(*commands: tuple[Address, LinkCommand], off: Address | None = None) -> list[list[LinkEvent]]:
    """What three hosts learn, at time 0, of commands given one after the other."""
    kernel = Kernel()
    channel = IdealChannel(IdealSettings(), kernel, Trace([]), 3)
    hosts = [Host() for _ in range(3)]
    for address, host in enumerate(hosts):
        channel.attach(address, host)
    if off is not None:
        channel.power(off, False)
    for source, command in commands:
        channel.command(source, command)
        assert all(time == 0 for host in hosts for time, _ in host.events)
    kernel.run(1)
    return [[event for _, event in host.events if isinstance(event, ModeChanged | RoleChanged)] for host in hosts]


@pytest.mark.parametrize("command", [Hold(1, 100), Sniff(1, 100, 0, 2), Park(1), Unpark(1)])
def test_links_are_never_at_rest(command: LinkCommand) -> None:
    assert answers((0, command)) == [[ModeChanged(1, Mode.ACTIVE)], [], []]
    assert answers((0, command), off=1) == [[ModeChanged(1, Mode.NONE)], [], []]


def test_roles_are_exchanged_on_both_sides_and_back() -> None:
    assert answers((0, Page(1)), (0, SwitchRole(1)), (0, SwitchRole(1))) == [
        [RoleChanged(1, Role.SLAVE), RoleChanged(1, Role.MASTER)],
        [RoleChanged(0, Role.MASTER), RoleChanged(0, Role.SLAVE)],
        [],
    ]
    assert answers((0, Page(1)), (1, SwitchRole(0)))[1] == [RoleChanged(0, Role.MASTER)]


def test_the_last_page_decides_who_has_which_role() -> None:
    assert answers((0, Page(1)), (1, Page(0)), (0, SwitchRole(1)))[0] == [RoleChanged(1, Role.MASTER)]


def test_without_a_page_there_are_no_roles_and_without_a_peer_no_link() -> None:
    assert answers((0, SwitchRole(1)))[0] == [RoleChanged(1, Role.PEER)]
    assert answers((0, SwitchRole(7)), (0, SwitchRole(0)))[0] == [
        ModeChanged(7, Mode.NONE),
        ModeChanged(0, Mode.NONE),
    ]
