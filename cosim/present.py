"""What has begun in a run and is not over: what makes rows of tables only when it ends."""

from collections.abc import Sequence
from typing import NamedTuple

from cosim.channels.base import Flying
from cosim.intervals import Interval
from cosim.payloads import HeldRow
from cosim.units import Time


class Present(NamedTuple):
    """A moment of a run."""

    now: Time
    under_way: Sequence[Interval] = ()
    """What radios, robots and jammers are doing; nothing unless the trace wants the table ``intervals``."""
    held: Sequence[HeldRow] = ()
    """Rows of the payloads that radios hold; none unless the trace wants the table ``payloads``."""
    flying: Sequence[Flying] = ()
    """The frames that are on the air."""
