"""Faults as intervals: from when to when each lasts, by hand, and what is under way in the midst of a run."""

from itertools import pairwise
from typing import Any

import pytest

from cosim.intervals import HOST, JAMMER, STATES, Interval
from cosim.simulation import Simulation
from cosim.trace import INTERVALS, TABLES
from cosim.units import MS, S, Time
from tests.faults.fault_scene import kill, radio_off, scenario

Row = tuple[Time, int, Time, int, str, str]
FADING = {"kind": "bluetooth", "propagation": {"model": "free_space"}}
JAMMERS = {"kind": "jammer", "x_m": 1.5, "y_m": 2.0}


def fault(kind: str, robot: int, at_s: float, for_s: float | None = None, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "robot": robot, "at_s": at_s, **({} if for_s is None else {"for_s": for_s}), **more}


def intervals(*faults: dict[str, Any], **changes: Any) -> list[Row]:
    """Return the intervals of robots and of nobody, and of radios that are off; not what else radios are doing."""
    run = Simulation(scenario(*faults, **changes), 1, (INTERVALS,))
    run.run()
    rows = list(zip(*run.trace.columns("intervals").values(), strict=True))
    assert all(state in STATES for *_, state, _ in rows)
    return sorted(row for row in rows if row[3] == HOST or row[4] == "off")


def test_a_crash_lasts_until_the_boot_and_a_death_until_the_end_of_the_run_with_the_radio_off() -> None:
    assert intervals(fault("crash", 0, 1.05, 2.0), kill(1, 2.5), duration_s=4.0) == [
        (1050 * MS, 0, 3050 * MS, HOST, "crashed", ""),
        (1050 * MS, 0, 3050 * MS, 0, "off", ""),
        (2500 * MS, 1, 4 * S, HOST, "killed", ""),
        (2500 * MS, 1, 4 * S, 0, "off", ""),
    ]


def test_faults_of_one_kind_that_overlap_are_one_interval_and_death_ends_all_others() -> None:
    frozen = fault("frozen", 0, 1.0, 1.0), fault("frozen", 0, 1.5, 1.5), fault("frozen", 1, 1.0)
    blind = fault("camera_off", 1, 0.5), fault("camera_off", 0, 3.0, 0.25)
    assert intervals(*frozen, *blind, kill(1, 2.0), duration_s=4.0) == [
        (500 * MS, 1, 2 * S, HOST, "camera_off", ""),
        (1 * S, 0, 3 * S, HOST, "frozen", ""),
        (1 * S, 1, 2 * S, HOST, "frozen", ""),
        (2 * S, 1, 4 * S, HOST, "killed", ""),
        (2 * S, 1, 4 * S, 0, "off", ""),
        (3 * S, 0, 3250 * MS, HOST, "camera_off", ""),
    ]


def test_a_clock_that_is_stepped_is_so_much_ahead_until_the_next_step_and_right_without_an_interval() -> None:
    steps = (
        fault("clock_step", 0, 1.0, by_s=2.0),
        fault("clock_step", 0, 2.0, by_s=-3.0),
        fault("clock_step", 0, 3.0, by_s=1.0),
    )
    assert intervals(*steps, duration_s=4.0) == [
        (1 * S, 0, 2 * S, HOST, "clock_stepped", f"by_ns={2 * S}"),
        (2 * S, 0, 3 * S, HOST, "clock_stepped", f"by_ns={-S}"),
    ]


def test_the_radio_that_a_fault_switches_off_is_off_and_no_radio_is_that_a_robot_does_not_have() -> None:
    two = {"kind": "radios", "radios": [{"kind": "ideal"}, {"kind": "optical"}]}
    faults = {**radio_off(0, 1.0, 2.0), "radio": 1}, radio_off(1, 1.5, 2.5)
    assert intervals(*faults, channel=two, team={"radios": [0, 1]}, duration_s=4.0) == [
        (1 * S, 0, 2 * S, 1, "off", ""),
        (1500 * MS, 1, 2500 * MS, 0, "off", ""),
        (1500 * MS, 1, 2500 * MS, 1, "off", ""),
    ]
    groups = {"groups": [{"size": 1, "radios": [0, 1]}, {"size": 1, "radios": [0]}]}
    assert intervals(kill(1, 3.0), channel=two, team=groups, duration_s=4.0) == [
        (3 * S, 1, 4 * S, HOST, "killed", ""),
        (3 * S, 1, 4 * S, 0, "off", ""),
    ]


def test_jammers_and_walls_are_intervals_of_nobody_that_say_what_they_are() -> None:
    faults = (
        JAMMERS | {"at_s": 0.5, "for_s": 1.0, "channels": [3, 4, 5, 9, 2], "mode": "sweeping", "dwell_s": 0.25},
        JAMMERS | {"at_s": 1.0, "power_dbm": -7.5, "mode": "pulsed", "on_s": 0.01, "period_s": 0.5, "radio": 0},
        {"kind": "wall", "from_m": [2, 0], "to_m": [2, 20.5], "loss_db": 12.5, "at_s": 0.2, "until_s": 3.0},
        JAMMERS | {"channels": [7]},
    )
    assert intervals(*faults, channel=FADING, duration_s=4.0) == [
        (0, JAMMER, 4 * S, HOST, "jammer", "fault=3 nth=0 x_m=1.5 y_m=2.0 power_dbm=20.0 channels=7 mode=constant"),
        (200 * MS, JAMMER, 3 * S, HOST, "wall", "fault=2 nth=0 x1_m=2.0 y1_m=0.0 x2_m=2.0 y2_m=20.5 loss_db=12.5"),
        (
            *(500 * MS, JAMMER, 1500 * MS, HOST, "jammer"),
            f"fault=0 nth=0 x_m=1.5 y_m=2.0 power_dbm=20.0 channels=3-5,9,2 mode=sweeping dwell_ns={250 * MS}",
        ),
        (
            *(1 * S, JAMMER, 4 * S, HOST, "jammer"),
            "fault=1 nth=0 x_m=1.5 y_m=2.0 power_dbm=-7.5 channels=0-78 mode=pulsed "
            f"on_ns={10 * MS} period_ns={500 * MS} radio=0",
        ),
    ]


def test_a_jammer_at_random_is_an_interval_each_time_that_it_is_on_also_where_they_overlap() -> None:
    again = JAMMERS | {"rate_per_s": 4.0, "for_s": 0.5}
    run = Simulation(scenario(again, channel=FADING, duration_s=10.0), 1, (INTERVALS,))
    run.run()
    events, rows = run.trace.columns("events"), run.trace.columns("intervals")
    begun = [t for t, event in zip(events["time_ns"], events["event"], strict=True) if event == "JammerOn"]
    assert len(begun) > 20
    assert any(later - earlier < 500 * MS for earlier, later in pairwise(begun))
    of_all = zip(rows["start_ns"], rows["end_ns"], rows["detail"], rows["state"], strict=True)
    told = sorted(row[:3] for row in of_all if row[3] == "jammer")
    assert [(start, end) for start, end, _ in told] == [(t, min(t + 500 * MS, 10 * S)) for t in begun]
    assert [int(detail.split()[1].removeprefix("nth=")) for *_, detail in told] == list(range(len(begun)))


def test_what_is_under_way_is_told_by_radios_robots_and_jammers_in_the_midst_of_a_run() -> None:
    faults = fault("crash", 0, 1.0, 2.0), JAMMERS | {"at_s": 0.5, "channels": [7]}, radio_off(1, 1.5, 2.5)
    run = Simulation(scenario(*faults, channel={"kind": "adhoc"}), 1, (INTERVALS,))
    run.begin()
    run.advance(2 * S)
    jammer = "fault=1 nth=0 x_m=1.5 y_m=2.0 power_dbm=20.0 channels=7 mode=constant"
    now = run.kernel.now
    found = sorted(interval for interval in run.present.under_way if interval.state in ("off", "crashed", "jammer"))
    assert found == [
        Interval(500 * MS, JAMMER, now, HOST, "jammer", jammer),
        Interval(1 * S, 0, now, HOST, "crashed", ""),
        Interval(1 * S, 0, now, 0, "off", ""),
        Interval(1500 * MS, 1, now, 0, "off", ""),
    ]


@pytest.mark.parametrize("kind", ["ideal", "optical", "adhoc", "bluetooth"])
def test_a_run_has_the_same_digest_and_kernel_events_whether_tables_are_kept_or_not(kind: str) -> None:
    lasting = fault("crash", 0, 1.0, 0.5), fault("frozen", 1, 1.0, 2.0), fault("clock_step", 1, 1.0, by_s=1.0)
    made = scenario(*lasting, kill(1, 3.0), channel={"kind": kind}, far_m=2.0)
    with_rows, without = Simulation(made, 1, tuple(TABLES.values())), Simulation(made, 1)
    one, other = with_rows.run(), without.run()
    assert (one.digest, one.metrics) == (other.digest, other.metrics)
    assert with_rows.trace.columns("intervals")["radio"].count(HOST) == 4
    assert without.present.under_way == []
