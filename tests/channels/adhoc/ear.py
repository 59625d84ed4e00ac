"""One station's receiver, given frames and jammers by hand, instant by instant."""

from cosim.channels.adhoc import reception
from cosim.channels.adhoc.air import begin, new_frame, next_arrival
from cosim.channels.adhoc.errors import tables
from cosim.channels.adhoc.mac import DATA, Access, Form, Limits, Timing
from cosim.channels.adhoc.phy import DSSS
from cosim.channels.adhoc.settings import form
from cosim.channels.adhoc.state import NONE, Record, new_network
from cosim.machine import BROADCAST, Address
from cosim.randomness import Draws
from cosim.units import US, Time

LIMITS = Limits(1e-9, 1e-8, 1e-6, 4.0)
FRAME = form(DSSS, 1000, 225)
"""1 Mb/s: 192 us of preamble and header, 1,800 us of octets."""
OWN = 0
"""Address of the station."""


class Ear:
    """The receiver of station 0."""

    def __init__(self, limits: Limits = LIMITS) -> None:
        timing = Timing(0, 0, 0, 0, 0, 1 * US, 0, FRAME, FRAME, FRAME, _never, _never)
        self.network = new_network(6, timing, Access(), limits, Draws(1, "ear").key, tables(()), 0)

    @property
    def station(self) -> Record:
        return self.network.stations[OWN]

    @property
    def energy(self) -> bool:
        return bool(reception.energy(self.network, OWN))

    @property
    def follows(self) -> bool:
        return bool(self.station["followed"] != NONE)

    def frame(self, source: Address, now: Time) -> int:
        """Put a frame on the air that begins to arrive *now*; return its number."""
        number: int = new_frame(self.network)
        frame = self.network.frames[number]
        frame["kind"], frame["source"], frame["destination"], frame["packet"] = DATA, source, BROADCAST, NONE
        frame["form"] = tuple(FRAME)
        begin(self.network, number, now - 1 * US)
        assert next_arrival(self.network, now) == number
        return number

    def begins(self, number: int, mw: float, now: Time, deaf: bool = False) -> bool:
        self.station["sending"] = 99 if deaf else NONE
        return bool(reception.begins(self.network, OWN, number, mw, now))

    def ends(self, number: int, now: Time) -> int:
        return int(reception.ends(self.network, OWN, number, now))

    def disturb(self, mw: float, at: Time) -> bool:
        return bool(reception.disturb(self.network, OWN, mw, at))


def _never(octets: int) -> Form:
    raise AssertionError
