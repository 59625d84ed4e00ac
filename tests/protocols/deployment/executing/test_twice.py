"""Robots that deploy twice in one play: their posts of before are theirs no more."""

from collections import Counter
from pathlib import Path

import pytest

from tests.protocols.deployment.crew_scene import run

PLAY = """
plays:
  twice:
    parameters: {first: {kind: places}, then: {kind: places}, robots: {kind: robots}}
    tasks:
      - {kind: deploy, label: first, strategy: leap_frog, robots: [robots], places: [first]}
      - {kind: deploy, label: then, strategy: leap_frog, robots: [robots], places: [then]}
"""


@pytest.mark.slow
def test_who_makes_room_is_not_called_back_to_the_post_of_a_deployment_before(tmp_path: Path) -> None:
    path = tmp_path / "plays.yaml"
    path.write_text(PLAY)
    places = {"first": [[4.0, 3.0], [5.0, 3.0], [6.0, 3.0]], "then": [[8.0, 3.0], [9.2, 3.0], [10.4, 3.0]]}
    call = {"call": {"play": "twice", "parameters": {**places, "robots": [0, 1, 2]}}}
    outcome = run(calls=[call], library=str(path))
    assert outcome.metrics["plans_done"] == outcome.metrics["deployed"] == 1.0
    assert outcome.metrics["asides"] > 0.0
    events = outcome.trace.arrow("events").to_pylist()
    told = Counter((row["time_ns"], row["robot"]) for row in events if row["event"] == "Ordered")
    assert max(told.values()) == 1
    assert outcome.metrics["orders"] < 60.0
