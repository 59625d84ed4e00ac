"""The index of a reproduction: all claims of all papers, and what we found."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final
from urllib.parse import quote

from cosim.report.markup import Html, identifier, joined, tag
from cosim.report.page import (
    UNDECIDED,
    VERDICTS,
    chance_of,
    claims_table,
    counts,
    document,
    limits_of,
    scrolling,
    verdict_word,
)
from cosim.report.tried import Judged, Tried, index_rows

QUICK: Final = (
    "Quick sweeps, of few runs: more stays open, some arms of whole sheets are missing, and where figures.py asks for "
    "a proof, a claim may fail for want of runs."
)
"""What a reader of a quick reproduction must know."""
COLUMNS: Final = ("verdict", "claim", "published", "ours", "why")


def index_page(tried: Mapping[str, Tried], quick: bool) -> str:
    """Return the page over all claims of the experiments *tried*, by their names."""
    rows = index_rows(tried.values())
    papers = list(dict.fromkeys(row.paper for row in rows))
    whole = any(row.whole for row in rows)
    verdicts = [verdict for each in tried.values() for verdict in each.verdicts()]
    sections = {
        "totals": ("All claims, by paper", joined([_totals(rows, papers), *chance_of(verdicts), *limits_of(verdicts)])),
        "whole": ("Beside the whole sheets", _beside(rows, tried)) if quick or whole else ("", Html()),
        "experiments": ("Experiments", _experiments(tried)),
    }
    for paper in papers:
        ours = [row for row in rows if row.paper == paper]
        sections[identifier("paper", paper)] = (_called(paper), _claims(ours, tried))
    there = {id_: each for id_, each in sections.items() if each[1]}
    failed = sum(bool(each.error) for each in tried.values())
    lead = f"{len(rows)} claims of {len(papers)} sources, held against {len(tried)} experiments."
    size = QUICK if quick else "Whole sheets."
    head = [counts(row.verdict for row in rows), tag("p", size, class_="quiet")]
    if failed:
        head.append(tag("p", f"{failed} of the experiments have no report: see below."))
    return document("What the papers claim, and what we find", "Reproduction", lead, head, there)


def _called(paper: str) -> str:
    return f"Paper {paper}" if paper.isdigit() else paper


def _totals(rows: Sequence[Judged], papers: Sequence[str]) -> Html:
    """Return how many claims of each paper have which verdict, with the sum."""
    words = [word for word in VERDICTS if any(row.verdict == word for row in rows)]
    heads = [
        tag("th", "source", scope="col"),
        *(tag("th", verdict_word(word), scope="col", class_="number") for word in words),
    ]
    heads.append(tag("th", "claims", scope="col", class_="number"))
    lines = []
    for paper in (*papers, None):
        found = Counter(row.verdict for row in rows if paper in (None, row.paper))
        name = tag("b", "all") if paper is None else tag("a", _called(paper), href=f"#{identifier('paper', paper)}")
        cells = [tag("td", found[word] or "", class_="number") for word in words]
        lines.append(tag("tr", tag("th", name, scope="row"), *cells, tag("td", sum(found.values()), class_="number")))
    table = tag("table", tag("thead", tag("tr", *heads)), tag("tbody", *lines))
    return scrolling(table, "Claims by source and verdict")


def _beside(rows: Sequence[Judged], tried: Mapping[str, Tried]) -> Html:
    """Return where the verdicts are others than those kept of whole sheets."""
    known = [row for row in rows if row.whole]
    if not known:
        why = "No verdicts of whole sheets are kept beside the published.csv of these experiments, to compare with. "
        return tag("p", why, tag("code", "cosim reproduce --keep"), " runs the whole sheets and keeps theirs.")
    other = [row for row in known if row.disagrees]
    decided = sum(row.verdict not in UNDECIDED for row in known)
    kept = f"Verdicts of whole sheets are kept of {len(known)} of the {len(rows)} claims."
    told = tag("p", f"{kept} Of these, {decided} are decided here, and {len(other)} otherwise than there.")
    lines = [
        (
            identifier("other", row.experiment, row.id),
            (verdict_word(row.verdict), _claim(row, tried), row.published, row.ours, verdict_word(row.whole)),
        )
        for row in other
    ]
    columns = (*COLUMNS[:-1], "whole sheet")
    return joined([told, claims_table("Verdicts other than the whole sheet's", columns, lines) if other else ""])


def _experiments(tried: Mapping[str, Tried]) -> Html:
    heads = ("experiment", "runs", "failed", "claims", "what went wrong")
    lines = [
        tag(
            "tr",
            tag("th", _page_of(each), scope="row"),
            *(tag("td", cell, class_="number") for cell in (each.runs, each.failed, len(each.claims))),
            tag("td", each.error),
        )
        for each in tried.values()
    ]
    numbers = {"runs", "failed", "claims"}
    head = tag("tr", *(tag("th", name, scope="col", class_="number" if name in numbers else None) for name in heads))
    return scrolling(tag("table", tag("thead", head), tag("tbody", *lines)), "Experiments")


def _claims(rows: Sequence[Judged], tried: Mapping[str, Tried]) -> Html:
    words = Counter(row.verdict for row in rows)
    told = tag("p", ", ".join(f"{words[word]} {word}" for word in VERDICTS if words[word]), class_="quiet")
    lines = [
        (
            identifier(row.experiment, row.id),
            (verdict_word(row.verdict), _claim(row, tried), row.published, row.ours, row.reason),
        )
        for row in rows
    ]
    return joined([told, claims_table(_called(rows[0].paper), COLUMNS, lines)])


def _claim(row: Judged, tried: Mapping[str, Tried]) -> Html:
    """Return what *row* claims and where, with the way to it on the experiment's page."""
    link = _page_of(tried[row.experiment], row.id)
    return joined([row.claim, tag("small", *([row.section, " · "] if row.section else []), link)])


def _page_of(tried: Tried, claim: str | None = None) -> Html:
    text = tried.name if claim is None else f"{tried.name}, {claim}"
    place = "" if claim is None else f"#{identifier('claim', claim)}"
    return tag("span", text) if tried.error else tag("a", text, href=f"{quote(tried.name)}.html{place}")
