"""News that nobody of the team can have meant: they are reported, and nothing begins because of them."""

import numpy as np
import pytest

from cosim.machine import Outgoing, Reception
from cosim.observation import Observation
from cosim.units import S
from protocols.deployment.driving.exploring import FIRST_TOPIC, TOPICS
from protocols.deployment.runner import Runner
from protocols.mapping import frames
from protocols.transport.frames import ALL, Frame, Publication, decode, encode
from protocols.wire import BadBytes
from tests.protocols.deployment.crew_scene import STARTS_M, setup


def topics_told(runner: Runner, topic: int, payload: bytes) -> set[int]:
    """Have a robot hear such news, and return the topics of what it tells in the next half minute."""
    data = encode(Frame(0, ALL, 0, Publication(topic, 1, payload)))
    runner.receive(data, Reception(0, True), 0)
    told = set()
    for now in range(0, 30 * S, S):
        runner.observe(Observation(*STARTS_M[1], 0.0, 0.0, True, False), now)
        runner.wake(now + S // 2)
        for each in runner.outbox():
            message = decode(each.payload).body if isinstance(each, Outgoing) else None
            told |= {message.topic} if isinstance(message, Publication) else set()
    return told


def machine() -> Runner:
    return Runner(*setup(), 1, 0, np.random.default_rng(0))


PIECE = frames.encode(0, frames.Summary(1.0, 1.0, ()))


@pytest.mark.parametrize("topic", [FIRST_TOPIC, FIRST_TOPIC + TOPICS, 200, 254])
def test_bytes_that_are_no_piece_of_a_map_make_nobody_tell_of_maps(topic: int) -> None:
    runner = machine()
    assert topics_told(runner, topic, b"stray") == {0}
    assert [event for event in runner.events() if isinstance(event, BadBytes)] == [BadBytes(0, 5)]


def test_a_piece_of_a_map_under_a_topic_that_nobody_tells_of_maps_by_is_none() -> None:
    runner = machine()
    assert topics_told(runner, FIRST_TOPIC + TOPICS, PIECE) == {0}
    assert [event for event in runner.events() if isinstance(event, BadBytes)] == [BadBytes(0, len(PIECE))]


def test_who_hears_of_a_map_tells_of_its_own() -> None:
    runner = machine()
    assert max(topics_told(runner, FIRST_TOPIC, PIECE)) >= FIRST_TOPIC
    assert not [event for event in runner.events() if isinstance(event, BadBytes)]
