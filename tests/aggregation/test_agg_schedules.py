"""Hosts crash or are cut off: nobody hangs, everybody finds a sub-team, and nothing that was reported is lost."""

import pytest

from tests.aggregation.fault_schedules import Watched, lost_reports, outsiders, schedule
from tests.oracles.campaign import soak_count


@pytest.mark.slow
@pytest.mark.parametrize("number", range(12))
def test_after_faults_everybody_is_in_one_sub_team_and_no_report_is_lost(number: int) -> None:
    run = Watched(schedule(number))
    assert run.whole
    assert outsiders(run) == []
    assert lost_reports(run) == []
