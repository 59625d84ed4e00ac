"""Role switch (Core v1.2, Vol 2 Part B, section 8.6.5): master and slave of a link change places.

The new master's address and clock give the hop sequence from then on, so the link moves to its piconet; payloads for
the other move with it, with their sequence bits, so that nothing is lost or delivered twice. What the old master had to
broadcast is flushed: a slave does not broadcast. A link is turned round only if neither device has another, so that no
third one has to follow; between two slot pairs; and only if both hear each other and the link is active. The air time
of the link manager's messages and of the slot adjustment (LMP, FHS) is neglected.
"""

from collections.abc import Callable
from typing import Protocol

from cosim.channels.bluetooth.piconet import Piconet
from cosim.channels.bluetooth.queues import News
from cosim.kernel import Kernel
from cosim.machine import Address, Mode, ModeChanged, Role, RoleChanged


class Partner(Protocol):
    """What a role switch must know of a device."""

    address: Address
    master_of: Piconet
    masters: dict[Address, Piconet]

    @property
    def idle(self) -> bool:
        """Whether no procedure is under way, or waits."""

    def left(self, master: Address) -> None:
        """Note that its link in the piconet of *master* is gone, without its host."""

    def linked(self, master: Address) -> None:
        """Note that a link in the piconet of *master* has come up."""


def switch_roles(kernel: Kernel, one: Partner, other: Partner, tell: Callable[[News], None]) -> None:
    """Turn the link between two devices round as the host of *one* asks for; *tell* takes the answer.

    It waits for the end of the slot pair under way; what stands against the switch is looked at then.
    """
    if one.address not in other.masters and other.address not in one.masters:
        tell([(one.address, ModeChanged(other.address, Mode.NONE))])
        return
    master, slave = (other, one) if other.address in one.masters else (one, other)
    boundary = master.master_of.boundary()
    if boundary > kernel.now:
        kernel.at(boundary, lambda: switch_roles(kernel, one, other, tell))
        return
    if not _may_switch(master, slave):
        tell([(one.address, RoleChanged(other.address, Role.MASTER if one is master else Role.SLAVE))])
        return
    news = master.master_of.hand_over(slave.address, slave.master_of)
    slave.left(master.address)
    master.left(master.address)
    master.masters[slave.address] = slave.master_of
    for device in (slave, master):
        device.linked(slave.address)
    switched = [
        (slave.address, RoleChanged(master.address, Role.MASTER)),
        (master.address, RoleChanged(slave.address, Role.SLAVE)),
    ]
    tell([*news, *switched])


def _may_switch(master: Partner, slave: Partner) -> bool:
    modes = master.master_of.modes
    alone = not master.masters and modes.members() == [slave.address]
    alone = alone and list(slave.masters) == [master.address] and not slave.master_of.modes.members()
    active = modes.mode(slave.address) is Mode.ACTIVE and modes.both_hear(slave.address)
    return alone and active and master.idle and slave.idle
