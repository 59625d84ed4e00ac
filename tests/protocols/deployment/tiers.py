"""Properties that are tried a few times in the slow tier, and as often as one likes in the soak tier."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from tests.oracles.campaign import soak_count


def tiers(few: int, many: int, *strategies: Any) -> Callable[[Callable[..., None]], Any]:
    """Return what makes two tests of a property: one of *few* examples, and one of the wished share of *many*."""

    def decorate(law: Callable[..., None]) -> Any:
        def test(examples: int) -> None:
            quiet = [HealthCheck.too_slow, HealthCheck.nested_given]
            settings(max_examples=examples, suppress_health_check=quiet)(given(*strategies)(law))()

        test.__name__, test.__doc__, test.__module__ = law.__name__, law.__doc__, law.__module__
        slow = pytest.param(few, marks=pytest.mark.slow, id="few")
        soak = pytest.param(soak_count(many), marks=pytest.mark.soak, id="soak")
        return pytest.mark.parametrize("examples", [slow, soak])(test)

    return decorate
