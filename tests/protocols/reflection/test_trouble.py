"""State sharing: when trouble begins and ends, worked out by hand from section 5 of the paper."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.reflection.trouble import Progress, Trouble


def drive(trouble: Trouble, steps: str) -> str:
    """Make steps with progress (+) or without (-), and return T where the robot is in trouble after it, else a dot."""
    return "".join("T" if (trouble.step(sign == "+"), trouble.active)[1] else "." for sign in steps)


def test_trouble_begins_at_cr_and_ends_at_zero() -> None:
    trouble = Trouble(3)
    assert drive(trouble, "--") == ".."
    assert drive(trouble, "-") == "T"
    assert drive(trouble, "---") == "TTT"
    assert trouble.level == 3  # bounded by Nt Cr
    assert drive(trouble, "++") == "TT"
    assert drive(trouble, "+") == "."
    assert trouble.weight == 2


def test_the_second_trouble_comes_sooner_and_lasts_longer() -> None:
    trouble = Trouble(3)
    drive(trouble, "---+++")
    assert drive(trouble, "--") == ".T"  # 2, then 4 >= 3
    assert drive(trouble, "---") == "TTT"
    assert trouble.level == 6  # 2 Cr
    assert drive(trouble, "++++++") == "TTTTT."


def test_the_printed_rule_jumps_over_cr() -> None:
    printed = Trouble(3, "equals")
    assert drive(printed, "---+++") == "..TTT."
    assert drive(printed, "--------") == "........"  # 2, 4, 6, 6: never 3
    assert drive(printed, "+++") == "..T"  # on the way down it is


def test_a_change_is_reported_once() -> None:
    trouble = Trouble(2)
    assert [trouble.step(False) for _ in range(4)] == [False, True, False, False]
    assert [trouble.step(True) for _ in range(3)] == [False, True, False]


@given(st.integers(1, 6), st.text("+-", max_size=200))
def test_pr_stays_between_zero_and_nt_cr(limit: int, steps: str) -> None:
    trouble = Trouble(limit)
    for sign in steps:
        before = trouble.active
        trouble.step(sign == "+")
        assert 0 <= trouble.level <= trouble.weight * limit
        assert trouble.active == (trouble.level >= limit or (before and trouble.level > 0))


GOAL = (10.0, 0.0)


def judge(progress: Progress, xs: list[float]) -> list[bool]:
    return [progress.judge(x, 0.0, GOAL) for x in xs]


def test_steps_and_windows_measure_what_is_gained() -> None:
    to_and_fro = [0.0, 0.1, 0.0, 0.1, 0.0, 0.1]
    assert judge(Progress("step", 4, 0.5, 0.1), to_and_fro) == [True, True, False, True, False, True]
    assert judge(Progress("window", 4, 0.5, 0.1), to_and_fro) == [True, True, False, False, False, False]
    ahead = [0.1 * k for k in range(6)]
    assert all(judge(Progress("window", 4, 0.5, 0.1), ahead))


def test_the_nearest_place_so_far_has_to_be_beaten() -> None:
    xs = [0.0, 1.0, 0.5, 0.9, 1.02, 1.2]
    assert judge(Progress("nearest", 1, 0.5, 0.1), xs) == [True, True, False, False, False, True]


def test_motion_counts_wherever_it_leads() -> None:
    away = [-0.1 * k for k in range(5)]
    assert all(judge(Progress("motion", 4, 0.5, 0.1), away))
    assert not any(judge(Progress("window", 4, 0.5, 0.1), away)[1:])
    assert judge(Progress("motion", 4, 0.5, 0.1), [0.0, 0.0, 0.0])[1:] == [False, False]


@pytest.mark.parametrize("measure", ["window", "nearest", "step", "motion"])
def test_a_new_target_begins_with_progress(measure: str) -> None:
    progress = Progress(measure, 3, 0.5, 0.1)  # type: ignore[arg-type]
    judge(progress, [1.0, 1.0, 1.0])
    assert not judge(progress, [1.0])[0]
    progress.restart()
    assert judge(progress, [1.0]) == [True]
