"""What all parts of the channel share in a run."""

from typing import NamedTuple

from cosim.channels.ble.ether import Ether, Judgement
from cosim.channels.ble.hosts import Hosts, Record
from cosim.channels.ble.packets import Sent
from cosim.kernel import Kernel
from cosim.machine import Address


class Environment(NamedTuple):
    """The clock, the air, the hosts and the tables of one run."""

    kernel: Kernel
    ether: Ether
    hosts: Hosts
    record: Record

    def judged(self, packet: Sent, receiver: Address) -> Judgement:
        """Return, and write down, what a *receiver* that has listened to all of *packet*, just over, makes of it."""
        judgement = self.ether.judge(packet, receiver)
        if self.record.wanted:
            self.record.judged(packet, receiver, judgement)
        return judgement
