"""docs/tables.md says what the code says."""

import sys
from dataclasses import dataclass, field, replace

import pytest

from cosim.data_dictionary import page
from cosim.protocol import Metric
from cosim.scenario import protocol_names, protocol_spec
from cosim.trace import TABLES
from tests.checkout import DATA, ROOT

DOCUMENT = ROOT / "docs" / "tables.md"


@dataclass
class Heard:
    """Somebody was heard.

    More about this.
    """

    power_dbm: float = field(metadata={"unit": "dBm", "meaning": "received | measured"})


@pytest.fixture
def described(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.syspath_prepend(str(DATA))
    monkeypatch.delitem(sys.modules, "beacon", raising=False)
    spec = replace(protocol_spec("beacon:SPEC"), events=(Heard,), metrics=(Metric("calls", "1", "calls heard"),))
    return page([spec])


def test_the_document_is_the_one_that_the_code_makes():
    ours = [
        spec for spec in map(protocol_spec, protocol_names()) if f"## Protocol {spec.name}\n" in DOCUMENT.read_text()
    ]
    made = page(ours)
    assert DOCUMENT.read_text(encoding="utf-8") == made, (
        "make it anew: python -m cosim.data_dictionary > docs/tables.md"
    )


def test_every_column_and_metric_says_what_it_means():
    assert "|  |\n" not in DOCUMENT.read_text(encoding="utf-8")


def test_every_protocol_of_ours_is_in_the_document():
    declared = (DOCUMENT.parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    section = declared.partition('[project.entry-points."cosim.protocols"]\n')[2].partition("\n[")[0]
    names = [line.partition(" =")[0] for line in section.splitlines() if " =" in line]
    assert names
    for name in names:
        assert f"## Protocol {name}\n" in DOCUMENT.read_text(encoding="utf-8")


def test_every_column_of_every_table_has_its_row(described: str):
    for table in TABLES.values():
        _, _, section = described.partition(f"### `{table.name}`\n")
        rows = section.partition("\n#")[0]
        for item in table.fields:
            assert f"| `{item.name}` | {item.kind} | {item.unit} | {item.meaning} |\n" in rows


def test_events_and_metrics_of_a_protocol_have_their_rows(described: str):
    _, _, section = described.partition("## Protocol beacon\n")
    assert "| `calls` | 1 | calls heard |\n" in section
    assert "`Heard`: Somebody was heard.\n\n| column" in section
    assert "More about this" not in section
    assert "| `power_dbm` | float | dBm | received / measured |\n" in section


def test_a_protocol_that_is_not_described_is_missing(described: str):
    assert "## Protocol pseudonet" not in described
