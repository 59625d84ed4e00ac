"""What all parts of the channel share in a run."""

from typing import NamedTuple

from cosim.channels.ble.ether import Ether
from cosim.channels.ble.hosts import Hosts, Record
from cosim.kernel import Kernel


class Environment(NamedTuple):
    """The clock, the air, the hosts and the tables of one run."""

    kernel: Kernel
    ether: Ether
    hosts: Hosts
    record: Record
