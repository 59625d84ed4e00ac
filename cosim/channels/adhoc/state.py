"""The state of all stations of one 802.11 network, as arrays of records that kernels work on.

One network is a few arrays in several files: ``agenda`` keeps what will happen, ``air`` the frames that are under way,
``reception`` what arrives at each station and whether it is received, ``dcf`` the access to the medium, ``advance``
carries out one event after another. ``stations`` is what the channel sees of all that.

Instants and durations are ns, powers mW. Where a field refers to a station, a frame, a packet or an event that is not
there, it is NONE.
"""

from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from cosim.arrays import Floats
from cosim.channels.adhoc.mac import Access, Form, Limits, Timing
from cosim.jit import COMPILES
from cosim.units import Time

Records: TypeAlias = np.ndarray[Any, np.dtype[np.void]]
Record: TypeAlias = Any
"""One element of an array of records, by whose fields kernels read and write the array."""

NONE: Final = -1
NEVER: Final = 1 << 62
"""An instant after all others."""

UNASKED: Final = 0
GRANTED: Final = 1
REFUSED: Final = 2

NOTHING: Final = 0
FAILURE: Final = 1
END: Final = 2

FORM: Final = np.dtype([(name, np.int64) for name in Form._fields], align=True)

COMMON: Final = np.dtype(
    [
        *((name, np.int64) for name in ("slot", "sifs", "difs", "eifs", "cca", "delay", "timeout")),
        *((name, FORM) for name in ("ack", "rts", "cts")),
        ("cw_min", np.int64),
        ("cw_max", np.int64),
        ("short_retries", np.int64),  # NEVER if without limit
        ("long_retries", np.int64),
        ("bianchi_counting", np.bool_),
        ("fades", np.bool_),  # frames have powers, else all in reach are alike
        *((name, np.float64) for name in Limits._fields),
        ("key_0", np.int64),  # of the draws
        ("key_1", np.int64),
        ("noted", np.bool_),  # the ends of all frames are told, for tables, at each station, too
        ("packets_noted", np.bool_),  # and so are those of all packets
        ("events", np.int64),  # number of events on the agenda
        ("orders", np.int64),  # number of events that have ever been put there
        ("told", np.int64),  # number of reports that wait
        ("intervals", np.int64),  # number of rows in each array of the ``Log``
        ("transmissions", np.int64),
        ("receptions", np.int64),
        ("urgent", np.bool_),  # one of them is for a host
        ("now", np.int64),  # instant and phase of the present event
        ("phase", np.int64),
        ("frames", np.int64),  # number of frames that have been on the air
        ("over", np.int64),  # number of these that have arrived to their end
        ("dropped", np.int64),  # number of packets that were not acknowledged
        ("first_begun", np.int64),  # the frames that have begun and not arrived yet
        ("last_begun", np.int64),
        ("first_there", np.int64),  # the frames that are arriving, in the order of their arrival
        ("last_there", np.int64),
        ("free_frame", np.int64),
        ("frames_under_way", np.int64),
        ("free_packet", np.int64),
        ("rowless", np.int64),  # the station whose row of powers is needed
        ("begun", np.int64),  # number of frames that other radios have not been told of
        ("arbitrates", np.bool_),  # some stations ask before they send
    ],
    align=True,
)
"""Times and rules, and what there is once."""

STATION: Final = np.dtype(
    [
        ("first", np.int64),  # the queue of packets
        ("last", np.int64),
        ("waiting", np.int64),  # number of packets in it
        ("numbers", np.int64),  # number of packets that it has ever been handed
        ("pending", np.bool_),  # there is a back-off to be done
        ("drawn", np.int64),  # number of back-offs that have been drawn
        ("window", np.int64),
        ("slots", np.int64),  # of the back-off that have not passed
        ("drawn_slots", np.int64),  # of the same when it was drawn, and the window then
        ("drawn_window", np.int64),
        ("not_before", np.int64),  # instant from which on they count
        ("counted_from", np.int64),
        ("ends", np.int64),  # end of the back-off, or of the space before a frame without; NEVER if not counting
        ("ends_event", np.int64),
        ("waits_from", np.int64),  # beginning of the space before it, for tables
        ("logged_to", np.int64),  # end of what they have of that
        ("idle_from", np.int64),
        ("reserved_until", np.int64),  # the network allocation vector
        ("erred", np.bool_),  # EIFS is due in place of DIFS
        ("sending", np.int64),  # frame
        ("exchanging", np.bool_),  # the first packet is on its way, from its first frame to its end or failure
        ("awaits", np.int64),  # kind of the answer
        ("awaits_from", np.int64),
        ("timeout_event", np.int64),
        ("act", np.int64),  # instant of the last event that was certain: the end of a frame, or an answer
        ("life", np.int64),  # number of times that the station has been switched off
        ("answer_kind", np.int64),
        ("answer_to", np.int64),
        ("answer_reserves", np.int64),
        ("answer_number", np.int64),
        ("arriving", np.int64),  # number of frames
        ("energy_from", np.int64),  # instant at which the medium became busy last
        ("followed", np.int64),  # frame
        ("followed_from", np.int64),
        ("spoilt", np.bool_),  # something has overlapped that frame; where all frames are alike
        ("jammed_from", np.int64),  # NEVER if no jammer is on
        ("jammers_mw", np.float64),
        ("log_chance", np.float64),  # of no error in that frame before level_from
        ("level", np.float64),  # ratio of its power to all others and noise since then
        ("level_from", np.int64),  # since it began to arrive
        ("least_level", np.float64),
        ("arbitrated", np.bool_),  # another radio of its robot may have the air: it asks before it sends
        ("permit", np.int64),  # what it has been told: UNASKED, GRANTED or REFUSED
        ("refused_until", np.int64),  # when the other radio's use is over
        ("used_until", np.int64),  # end of the last frame that it has sent, and of the time for its answers
        ("deaf_until", np.int64),  # end of what another radio of its robot sends
        ("deafened", np.bool_),  # such a radio has sent while that frame was followed
        ("lost_at", np.int64),  # end of the last frame for it that it has followed and not received, for tables
        ("row", np.int64),  # where its row begins, see ``Network.rows``; NONE if it must be asked for
        ("row_end", np.int64),
        ("sent_for", np.int64),  # time in which it has sent, followed frames, and been off, but for what goes on
        ("followed_for", np.int64),
        ("off_for", np.int64),
        ("off_from", np.int64),  # NEVER if it is on
    ],
    align=True,
)

PACKET: Final = np.dtype(
    [
        ("destination", np.int64),
        ("form", FORM),
        ("number", np.int64),
        ("short", np.int64),  # failures without a response to an RTS, or to a frame without one
        ("long", np.int64),  # failures of a frame after an RTS
        ("asks", np.bool_),  # an RTS precedes it
        ("awaited", np.int64),  # what somebody wants to hear of: NOTHING, FAILURE, or END, whatever becomes of it
        ("begun", np.int64),  # beginning of the first frame that carries it; NEVER before, for tables
        ("users", np.int64),  # the queue, and frames that are under way
        ("next", np.int64),  # in the queue, or among the free ones
    ],
    align=True,
)

FRAME: Final = np.dtype(
    [
        ("kind", np.int64),
        ("source", np.int64),
        ("destination", np.int64),
        ("form", FORM),
        ("reserves", np.int64),  # time after its end for which others keep silent (the duration field)
        ("number", np.int64),  # of the DATA that it belongs to, counted by the sender of that
        ("packet", np.int64),  # of DATA
        ("begin", np.int64),
        ("whole", np.bool_),  # its sender is on
        ("next", np.int64),
        ("row", np.int64),  # whom it reaches, as the sender's when it began to arrive
        ("row_end", np.int64),
    ],
    align=True,
)

EVENT: Final = np.dtype(
    [
        ("time", np.int64),
        ("rank", np.int64),  # phase and order
        ("kind", np.int64),
        ("who", np.int64),  # station or frame
        ("life", np.int64),  # of the station when it was put on the agenda
    ],
    align=True,
)

RECEIVED: Final = 0
"""A station has received DATA for it; again, if its answer was lost."""
DONE: Final = 1
"""A packet is off the queue."""
HEARD: Final = 2
"""A frame has arrived to its end at a station."""
OVER: Final = 3
"""A frame has arrived to its end everywhere."""
FINISHED: Final = 4
"""A packet is off the queue, whether its host waits for that or not."""

REPORT: Final = np.dtype(
    [
        ("what", np.int64),
        ("station", np.int64),
        ("packet", np.int64),
        ("right", np.bool_),  # received, acknowledged, or whole
        ("mw", np.float64),
        ("kind", np.int64),
        ("source", np.int64),
        ("destination", np.int64),
        ("begin", np.int64),
        ("duration", np.int64),
        ("reserves", np.int64),
        ("number", np.int64),
        ("again", np.bool_),  # the packet has failed before
        ("missed", np.bool_),  # it has reached nobody that it was meant for
    ],
    align=True,
)


BEGUN: Final = np.dtype([(name, np.int64) for name in ("begin", "end", "source")], align=True)
"""A frame that has begun, for other radios."""

INTERVAL: Final = np.dtype(
    [
        *((name, np.int64) for name in ("begin", "station", "end", "state")),
        ("slots", np.int64),  # of a back-off: what ``log.packed_slots`` returns; 0 of anything else
    ],
    align=True,
)
"""What a station was doing; its states stand in ``log``."""

TRANSMISSION: Final = np.dtype(
    [
        *((name, np.int64) for name in ("begin", "source", "kind", "destination", "reserves", "number", "duration")),
        ("packet", np.int64),
        ("again", np.bool_),  # the packet has failed before
        ("whole", np.bool_),
    ],
    align=True,
)
"""What was on the air."""

RECEPTION: Final = np.dtype(
    [
        *((name, np.int64) for name in ("begin", "source", "receiver", "outcome")),
        ("power_dbm", np.float64),  # NaN where it is not known
        ("sinr_db", np.float64),
    ],
    align=True,
)
"""What became of a frame at a station; its outcomes stand in ``log``."""


class Report(NamedTuple):
    """What the stations tell, as a row of ``Network.told``."""

    what: int
    station: int
    packet: int
    right: bool
    mw: float
    kind: int
    source: int
    destination: int
    begin: Time
    duration: Time
    reserves: Time
    number: int
    again: bool
    missed: bool


REACHED: Final = np.dtype([("address", np.int64), ("mw", np.float64)], align=True)


class Network(NamedTuple):
    """All of one network."""

    common: Records
    """(1,)"""
    stations: Records
    """(n,)"""
    packets: Records
    frames: Records
    """Frames that are under way, and room for more."""
    powers_mw: Floats
    """(frames, n): power of each frame at each station where it is arriving, else 0."""
    rows: Records
    """Stations that senders reach, rising, and with how much power, row after row."""
    agenda: Records
    """A binary heap."""
    told: Records
    cck: Floats
    """Table of bit errors, if a rate needs it."""
    begun: Records
    """What other radios have not been told of; without room if they hear nothing of it."""


class Log(NamedTuple):
    """What is kept for tables; an array without room is not wanted."""

    intervals: Records
    transmissions: Records
    receptions: Records


def new_network(
    size: int, timing: Timing, access: Access, limits: Limits | None, key: tuple[int, int], cck: Floats, now: Time
) -> Network:
    """Return a network of *size* stations that begin at *now*; without *limits* all frames in reach are alike."""
    common = new_records(1, COMMON)
    for name in ("slot", "sifs", "difs", "eifs", "cca", "delay", "timeout"):
        common[name] = getattr(timing, name)
    for name in ("ack", "rts", "cts"):
        common[name] = np.array(tuple(getattr(timing, name)), FORM)
    common["cw_min"], common["cw_max"], common["bianchi_counting"] = (
        access.cw_min,
        access.cw_max,
        access.bianchi_counting,
    )
    for name in ("short_retries", "long_retries"):
        limit = getattr(access, name)
        common[name] = NEVER if limit is None else limit
    common["fades"] = limits is not None
    for name, value in () if limits is None else limits._asdict().items():
        common[name] = value
    common["key_0"], common["key_1"] = key
    for name in ("first_begun", "last_begun", "first_there", "last_there", "free_frame", "free_packet", "rowless"):
        common[name] = NONE
    stations = new_records(size, STATION)
    for name in ("first", "last", "ends_event", "sending", "awaits", "timeout_event", "followed", "row"):
        stations[name] = NONE
    stations["ends"] = stations["jammed_from"] = stations["off_from"] = NEVER
    stations["act"] = NONE
    stations["window"], stations["idle_from"] = access.cw_min, now
    network = Network(
        common,
        stations,
        packets=new_records(0, PACKET),
        frames=new_records(0, FRAME),
        powers_mw=np.zeros((0, size)),
        rows=new_records(16 * size, REACHED),
        agenda=new_records(16 * size + 16, EVENT),
        told=new_records(16 * size + 16, REPORT),
        cck=cck,
        begun=new_records(0, BEGUN),
    )
    return with_packets(with_frames(network, 16), 64)


def with_frames(network: Network, more: int) -> Network:
    """Return *network* with room for *more* frames."""
    powers_mw = np.concatenate((network.powers_mw, np.zeros((more, len(network.stations)))))
    return network._replace(frames=_longer(network.frames, more, network.common, "free_frame"), powers_mw=powers_mw)


def with_packets(network: Network, more: int) -> Network:
    """Return *network* with room for *more* packets."""
    return network._replace(packets=_longer(network.packets, more, network.common, "free_packet"))


def new_records(count: int, fields: "np.dtype[np.void]") -> Records:
    """Return records whose fields plain Python can name as kernels do, where these are plain Python."""
    records = np.zeros(count, fields)
    return records if COMPILES else records.view(np.recarray)


def _longer(pool: Records, more: int, common: Records, free: str) -> Records:
    """Return *pool* with *more* records, which are free: a list by their field next."""
    before = len(pool)
    longer = np.concatenate((pool, new_records(more, pool.dtype)))
    longer["next"][before:] = [*range(before + 1, before + more), common[free][0]]
    common[free] = before
    return longer


def doubled(array: Records) -> Records:
    """Return *array* with twice the room."""
    return np.concatenate((array, new_records(len(array), array.dtype)))
