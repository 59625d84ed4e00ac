"""Parameters of AODV in a scenario: the constants of RFC 3561, section 10, and its options."""

from typing import Literal, NamedTuple

from pydantic import Field

from cosim.settings import Count, Seconds, Settings
from cosim.units import Time, from_seconds


class AodvTimes(NamedTuple):
    """Durations that follow from the constants (RFC 3561, section 10), in ns."""

    active_route: Time
    my_route: Time
    """MY_ROUTE_TIMEOUT = 2 * ACTIVE_ROUTE_TIMEOUT."""
    hello: Time
    loss: Time
    """ALLOWED_HELLO_LOSS * HELLO_INTERVAL."""
    traversal: Time
    """NODE_TRAVERSAL_TIME."""
    network: Time
    """NET_TRAVERSAL_TIME = 2 * NODE_TRAVERSAL_TIME * NET_DIAMETER."""
    discovery: Time
    """PATH_DISCOVERY_TIME = 2 * NET_TRAVERSAL_TIME."""
    blacklist: Time
    """BLACKLIST_TIMEOUT = RREQ_RETRIES * NET_TRAVERSAL_TIME."""
    delete: Time
    """DELETE_PERIOD = K * max(ACTIVE_ROUTE_TIMEOUT, HELLO_INTERVAL)."""
    next_hop_wait: Time
    """NEXT_HOP_WAIT = NODE_TRAVERSAL_TIME + 10 ms."""
    jitter: Time


class AodvSettings(Settings):
    """Parameters of ad hoc on-demand distance vector routing (RFC 3561): the defaults are the RFC's.

    NET_DIAMETER is best set to the number of robots: with 35 a search for a robot that is not there takes 21.5 s.
    """

    kind: Literal["aodv"] = "aodv"
    active_route_timeout_s: Seconds = Field(
        default=3.0, gt=0, description="s that a route lasts without use (the RFC: 10 at least with use_mac_feedback)"
    )
    hello_interval_s: Seconds = Field(
        default=1.0, gt=0, description="s without a broadcast, after which a hello is sent"
    )
    allowed_hello_loss: Count = Field(
        default=2, ge=1, description="hello intervals without a packet, after which a link is taken for broken"
    )
    net_diameter: int = Field(default=35, ge=1, le=255, description="hops between any two robots, at most")
    node_traversal_time_s: Seconds = Field(default=0.04, gt=0, description="s that a packet takes for a hop, all told")
    rreq_retries: Count = Field(default=2, ge=0, description="times that a search of the whole network is repeated")
    rreq_ratelimit: Count = Field(default=10, ge=1, description="route requests per second, at most; others wait")
    rerr_ratelimit: Count = Field(default=10, ge=1, description="route errors per second, at most; others are dropped")
    timeout_buffer: Count = Field(default=2, ge=0, description="hops by which the wait for a reply exceeds the ring")
    ttl_start: Count = Field(
        default=1, ge=1, description="hops that the first request of a search goes (with hellos 2)"
    )
    ttl_increment: Count = Field(default=2, ge=1, description="hops that each further one goes farther")
    ttl_threshold: Count = Field(default=7, ge=0, description="hops beyond which a request goes net_diameter hops")
    local_add_ttl: Count = Field(default=2, ge=0, description="hops that the request of a local repair goes farther")
    delete_factor: Count = Field(
        default=5, ge=1, description="K: an ended route is remembered K times the longer of timeout and hello interval"
    )
    use_hello: bool = Field(default=True, description="whether robots on active routes send hellos and miss them")
    hello_always: bool = Field(default=False, description="whether robots on no active route send hellos too")
    use_mac_feedback: bool = Field(
        default=True, description="whether a link is broken if the radio has not got an acknowledgement"
    )
    reboot_hold: bool = Field(
        default=True,
        description="whether a router that starts again takes no part in searches until others have forgotten it",
    )
    use_rrep_ack: bool = Field(
        default=False,
        description="whether route replies ask for an acknowledgement; a robot that sends none is blacklisted",
    )
    destination_only: bool = Field(default=False, description="whether only the destination may answer a request")
    gratuitous: bool = Field(default=True, description="whether a robot that replies for a destination informs it too")
    local_repair: bool = Field(default=False, description="whether a robot on the way looks for another way itself")
    salvages: Count = Field(
        default=1, ge=0, description="times that the source routes a payload again that the next hop has not taken"
    )
    queue_payloads: Count = Field(
        default=64, ge=1, description="payloads of a robot that wait for routes; the oldest gives way"
    )
    broadcast_ttl: int | None = Field(
        default=None,
        ge=1,
        le=255,
        description="hops that a payload to all makes at most, 1: none passes it on; net_diameter if not given",
    )
    broadcast_jitter_s: Seconds = Field(
        default=0.01,
        ge=0,
        description="s, at most, that a broadcast that is passed on is held back, and a hello early (not in the RFC)",
    )

    def times(self) -> AodvTimes:
        """Return all durations in ns."""
        active, hello = max(1, from_seconds(self.active_route_timeout_s)), max(1, from_seconds(self.hello_interval_s))
        traversal = max(1, from_seconds(self.node_traversal_time_s))
        network = 2 * traversal * self.net_diameter
        return AodvTimes(
            active_route=active,
            my_route=2 * active,
            hello=hello,
            loss=self.allowed_hello_loss * hello,
            traversal=traversal,
            network=network,
            discovery=2 * network,
            blacklist=self.rreq_retries * network,
            delete=self.delete_factor * max(active, hello),
            next_hop_wait=traversal + from_seconds(0.01),
            jitter=from_seconds(self.broadcast_jitter_s),
        )

    @property
    def payload_ttl_to_all(self) -> int:
        """Hops that a payload to all makes at most."""
        return self.net_diameter if self.broadcast_ttl is None else self.broadcast_ttl

    @property
    def max_repair_ttl(self) -> int:
        """MAX_REPAIR_TTL = 0.3 * NET_DIAMETER, hops to a destination that is worth a local repair."""
        return 3 * self.net_diameter // 10

    def first_ttl(self, last_hops: int | None) -> int:
        """Return how far the first request of a search goes, *last_hops* being the last known distance (6.4)."""
        ttl = self.ttl_start if last_hops is None else last_hops + self.ttl_increment
        return min(ttl, self.net_diameter)

    def next_ttl(self, ttl: int) -> int:
        """Return how far the request after one of *ttl* goes (6.4)."""
        further = ttl + self.ttl_increment
        return self.net_diameter if further > self.ttl_threshold else min(further, self.net_diameter)
