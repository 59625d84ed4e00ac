"""Faults of the air: walls of loss that stand for a while, jammers in the trace."""

from typing import Any

import numpy as np
import pytest

from cosim.channels.jamming import Jammer
from cosim.channels.propagation import Barrier, Propagation, PropagationSettings
from cosim.errors import UserError
from cosim.geometry.segments import segment_grid
from cosim.randomness import Draws
from cosim.simulation import Simulation
from cosim.units import MS, S, Time
from cosim.world.sight import wall_losses_db
from tests.faults.fault_scene import TICK, executed, kill, rows, scenario

# robots at (1, 5), (3, 5) and (5, 5)
BLUETOOTH = {"kind": "bluetooth", "propagation": {"model": "free_space"}}


def wall(at_s: float, until_s: float | None = None, loss_db: float = 200.0, **more: Any) -> dict[str, Any]:
    line = {"from_m": [2.0, 0.0], "to_m": [2.0, 20.0]}
    return {"kind": "wall", "at_s": at_s, "until_s": until_s, "loss_db": loss_db, **line, **more}


def in_reach(*faults: dict[str, Any], robot: int = 0, **changes: Any) -> list[tuple[int, ...]]:
    """Return whom *robot* reaches just after each tick."""
    run = Simulation(scenario(*faults, size=3, channel=BLUETOOTH, **changes), 1)
    found: list[tuple[int, ...]] = []
    for tick in range(8):
        run.kernel.at(tick * TICK + 1, lambda: found.append(run.channel.in_reach(robot)))
    run.run()
    return found


def test_a_wall_of_loss_parts_those_on_its_two_sides_while_it_is_there():
    assert in_reach(wall(0.2, 0.45)) == [(1, 2)] * 2 + [()] * 3 + [(1, 2)] * 3
    assert in_reach(wall(0.2, 0.45), robot=1) == [(0, 2)] * 2 + [(2,)] * 3 + [(0, 2)] * 3
    assert in_reach(wall(0.2)) == [(1, 2)] * 2 + [()] * 6


def test_walls_add_up_and_each_goes_when_it_is_over():
    # 4 dBm over 2 m and 4 m of free space: -42.2 and -48.3 dBm, heard with one wall, but not with two
    losses = [wall(0.2, 0.65, 35.0), wall(0.4, 0.55, 35.0, from_m=[2.5, 0.0], to_m=[2.5, 20.0])]
    assert in_reach(*losses) == [(1, 2)] * 4 + [()] * 2 + [(1, 2)] * 2
    assert in_reach(wall(0.2, 0.45, 35.0), wall(0.2, 0.65, 35.0)) == [(1, 2)] * 2 + [()] * 3 + [(1, 2)] * 3
    behind = wall(0.2, 0.65, from_m=[4.0, 0.0], to_m=[4.0, 20.0])
    assert in_reach(wall(0.2, 0.45), behind) == [(1, 2)] * 2 + [()] * 3 + [(1,)] * 2 + [(1, 2)]


def test_robots_drive_and_look_through_it():
    changes = {"far_m": 5.0, "use": "tests.faults.fault_scene:SEEING", "channel": BLUETOOTH}
    plain, walled = (executed(*faults, duration_s=4.0, **changes) for faults in ([], [wall(0.0)]))
    assert (plain.referee.path(0) == walled.referee.path(0)).all()
    assert walled.referee.path(0)[-1, 0] > 2.5
    assert all(observation.visible == (1,) for _, observation in walled.machines[0].observed)


def test_walls_are_in_the_trace_and_are_nobodys():
    run = executed(wall(0.2, 0.45), channel=BLUETOOTH, duration_s=1.0)
    assert rows(run) == [(200 * MS, -1, "WallUp"), (450 * MS, -1, "WallDown")]


def test_the_trace_says_which_wall_and_which_jammer():
    jammer = {"kind": "jammer", "x_m": 1.0, "y_m": 1.0, "at_s": 0.1, "until_s": 0.8}
    run = executed(wall(0.2, 0.5), jammer, wall(0.3, 0.4), channel=BLUETOOTH, duration_s=1.0)
    assert [event for *_, event in rows(run)] == ["JammerOn", "WallUp", "WallUp", "WallDown", "WallDown", "JammerOff"]
    assert run.trace.columns("events")["fault"] == [1, 0, 2, 2, 0, 1]


def test_a_barrier_takes_from_the_gains_what_a_wall_of_the_floor_takes():
    places = np.random.default_rng(1).uniform(0, 10, (12, 2))
    lines = np.random.default_rng(2).uniform(0, 10, (7, 4))
    losses = np.array([3.0, 5.0, 7.5, 1.0, 12.0, 0.25, 40.0])
    open_air, walled = (
        Propagation(PropagationSettings(shadowing_db=4.0), segment_grid(floor), loss, Draws(1, "shadowing"))
        for floor, loss in ((np.empty((0, 4)), []), (lines, losses))
    )
    open_air.set_barriers([Barrier(*line, loss) for line, loss in zip(lines, losses, strict=True)])
    assert np.array_equal(open_air.gains_db(places), walled.gains_db(places))
    assert (wall_losses_db(segment_grid(lines), losses, places) > 0).any()
    open_air.set_barriers([])
    assert (open_air.gains_db(places) > walled.gains_db(places)).any()


@pytest.mark.parametrize(
    ("channel", "expected"),
    [
        (
            {"kind": "ideal"},
            "faults[1]: a wall needs a channel whose signals fade: bluetooth, ble or adhoc, with propagation",
        ),
        ({"kind": "bluetooth"}, "faults[1]: radios without propagation notice no walls"),
    ],
)
def test_a_wall_that_no_radio_would_notice_is_refused(channel: dict[str, str], expected: str):
    with pytest.raises(UserError) as raised:
        Simulation(scenario(kill(0, 1.0), wall(1.0), channel=channel), 1)
    assert str(raised.value) == expected


def test_jammers_are_in_the_trace_and_come_with_a_rate(monkeypatch: pytest.MonkeyPatch):
    told: list[Jammer] = []
    jammer = {"kind": "jammer", "x_m": 1.0, "y_m": 1.0}
    run = executed({**jammer, "at_s": 0.5, "until_s": 1.5}, channel=BLUETOOTH, duration_s=2.0)
    assert rows(run) == [(500 * MS, -1, "JammerOn"), (1500 * MS, -1, "JammerOff")]
    monkeypatch.setattr("cosim.channels.bluetooth.device.BluetoothChannel.jam", lambda self, one: told.append(one))
    run = executed({**jammer, "rate_per_s": 4.0, "for_s": 0.1}, channel=BLUETOOTH, duration_s=4.0)
    spans: list[tuple[Time, Time]] = [(one.start, one.end) for one in told]
    assert len(spans) > 5
    assert {end - start for start, end in spans if end < 4 * S} == {100 * MS}
    assert [now for now, _, event in rows(run) if event == "JammerOn"] == [start for start, _ in spans]
