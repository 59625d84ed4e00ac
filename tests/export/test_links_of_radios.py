"""Links of two robots by two radios at once, as what reads the table of links tells them apart."""

from pathlib import Path
from typing import Any

from cosim.export.recording import of_run
from cosim.kernel import Kernel
from cosim.machine import Connected, Fate, LinkEvent, Lost, Outcome, Role
from cosim.node import Node
from cosim.trace import LINKS, POSES, StoredTable, Trace
from cosim.web.activity import linked
from tests.test_node import Puppet, Wire

NEWS: tuple[tuple[int, int, LinkEvent], ...] = (
    (10, 0, Connected(1, Role.MASTER)),
    (10, 1, Connected(0, Role.SLAVE)),
    (20, 0, Connected(1, Role.SLAVE, radio=1)),
    (20, 1, Connected(0, Role.MASTER, radio=1)),
    (25, 0, Fate(3, Outcome.DELIVERED, 1)),
    (30, 0, Lost(1)),
    (31, 1, Lost(0)),
    (40, 1, Lost(0, 1)),
)
"""(time, robot, event)"""


def told() -> Trace:
    trace = Trace([POSES, LINKS])
    nodes = [Node(robot, Puppet(), Kernel(), Wire(Kernel(), trace, 2), trace) for robot in (0, 1)]
    for time, robot, event in NEWS:
        nodes[robot].link(event, time)
    trace.row(POSES, 100, 0, 0.0, 0.0, 0.0)
    return trace


def test_a_recording_has_each_link_until_it_is_lost_by_its_own_radio() -> None:
    assert of_run(told(), {"radii_m": [0.2, 0.2]}, {}).links() == [(10, 30, 0, 1), (20, 40, 1, 0)]


def test_activity_is_that_of_each_radio(tmp_path: Path) -> None:
    trace = told()
    trace.write(tmp_path)
    found: list[Any] = sorted(linked(StoredTable(tmp_path / "links.parquet")))
    ended = [each for each in found if each.end <= 40]
    assert [(each.start, each.robot, each.end, each.radio, each.state, each.detail) for each in ended] == [
        (10, 0, 30, 0, "master", "slave=1"),
        (10, 1, 31, 0, "slave", "master=0"),
        (20, 1, 40, 1, "master", "slave=0"),
    ]
    assert [(each.start, each.robot, each.radio) for each in found if each not in ended] == [(20, 0, 1)]
