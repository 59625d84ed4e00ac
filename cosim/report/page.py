"""What the pages of reports share: one file each, which needs no other and no script."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pandas as pd

from cosim import __version__
from cosim.report.claims import LIMITS, Verdict, chance, limits_told
from cosim.report.markup import Html, joined, tag

VERDICTS: Final = ("holds", "fails", "open", "not comparable", "no data")
"""The words of verdicts, in the order in which they are told."""
UNDECIDED: Final = ("open", "no data")
"""Verdicts that say nothing which another one could contradict."""
_SIGNS: Final = {"holds": "✓", "fails": "✗", "open": "?", "not comparable": "≠", "no data": "–"}
"""What tells verdicts apart without their colours."""
_POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""A page loads nothing and runs nothing, whatever stands in it."""
MOST_ROWS: Final = 2000
"""The most rows of a table that a page shows."""


def document(
    title: str, kind: str, lead: object, head: Iterable[Html], sections: Mapping[str, tuple[str, Html]]
) -> str:
    """Return a whole page: *title* below its *kind*, a sentence, what follows on it, and *sections*.

    These are (heading, contents) by their ids.
    """
    style = Html((Path(__file__).parent / "page.css").read_text(encoding="utf-8"))
    ways = [tag("li", tag("a", heading, href=f"#{id_}")) for id_, (heading, _) in sections.items()]
    body = [
        tag("a", "To the contents", class_="skip", href="#contents"),
        tag(
            "header",
            tag("p", kind, class_="kind"),
            tag("h1", title),
            tag("p", lead, class_="lead") if lead else "",
            *head,
            tag("nav", tag("ul", *ways), aria_label="On this page"),
        ),
        tag(
            "main",
            *(
                tag("section", tag("h2", heading, id=id_), contents, aria_labelledby=id_)
                for id_, (heading, contents) in sections.items()
            ),
            id="contents",
            tabindex="-1",
        ),
        tag("footer", tag("p", f"Made by cosim {__version__}.", class_="quiet")),
    ]
    meta = [
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        tag("title", f"{title}: {kind}"),
        tag("style", style),
    ]
    page = tag("html", tag("head", joined(meta, "\n")), tag("body", joined(body, "\n")), lang="en")
    return f"<!doctype html>\n{page}\n"


def verdict_word(word: str) -> Html:
    """Return a verdict with its sign and its colour."""
    kind = word if word in ("holds", "fails", "open") else None
    sign = tag("span", _SIGNS.get(word, ""), aria_hidden="true")
    return tag("span", sign, " ", word, class_=f"verdict {kind}" if kind else "verdict")


def counts(words: Iterable[str]) -> Html:
    """Return how many of *words*, verdicts, there are of each."""
    found = Counter(words)
    return tag(
        "ul",
        *(tag("li", tag("b", found[word]), verdict_word(word)) for word in VERDICTS if found[word]),
        class_="counts",
        aria_label="Claims by verdict",
    )


def chance_of(verdicts: Iterable[Verdict]) -> list[Html]:
    """Return how many failures among *verdicts* chance alone explains; nothing if none could fail by chance."""
    found = chance(verdicts)
    return [tag("p", f"{found.text()}.")] if found else []


def limits_of(verdicts: Iterable[Verdict]) -> list[Html]:
    """Return what limits in brackets are; nothing if no answer among *verdicts* has any."""
    return [tag("p", LIMITS)] if limits_told(verdicts) else []


def claims_table(label: str, columns: Sequence[str], rows: Iterable[tuple[str, Sequence[object]]]) -> Html:
    """Return a table of claims, its *rows* (id, cells) a card each where the page is narrow.

    Its roles are said outright: a browser forgets those of a table that it shows as something else.
    """
    heads = [tag("th", column, scope="col", role="columnheader") for column in columns]
    kinds = {"claim": "claim", "published": "value", "ours": "value"}
    lines = []
    for id_, cells in rows:
        line = [
            tag(
                "td",
                cell,
                role="cell",
                class_=kinds.get(column),
                data_label=column if column not in ("verdict", "claim") else None,
            )
            for column, cell in zip(columns, cells, strict=True)
        ]
        lines.append(tag("tr", *line, role="row", id=id_))
    return tag(
        "table",
        tag("thead", tag("tr", *heads, role="row"), role="rowgroup"),
        tag("tbody", *lines, role="rowgroup"),
        class_="claims",
        role="table",
        aria_label=label,
    )


def frame_table(frame: pd.DataFrame, label: str) -> Html:
    """Return *frame* as a table that scrolls by itself, also by keys; of very many rows the first."""
    numeric = {column for column in frame if _all_numbers(frame[column])}
    heads = [tag("th", column, scope="col", class_="number" if column in numeric else None) for column in frame]
    lines = [
        tag(
            "tr",
            *(
                tag("td", _cell(each), class_="number" if name in numeric else None)
                for name, each in zip(frame, row, strict=True)
            ),
        )
        for row in frame.head(MOST_ROWS).itertuples(index=False, name=None)
    ]
    table = tag("table", tag("thead", tag("tr", *heads)), tag("tbody", *lines))
    left = len(frame) - MOST_ROWS
    more = tag("p", f"and {left} rows more", class_="quiet") if left > 0 else ""
    return joined([scrolling(table, label), more])


def scrolling(contents: Html, label: str) -> Html:
    """Return *contents* in a box that scrolls if they are wider than the page, also by keys."""
    return tag("div", contents, class_="wide", tabindex="0", role="group", aria_label=label)


def terms(pairs: Mapping[str, object]) -> Html:
    """Return a list of terms and what they are."""
    return tag("dl", *(joined([tag("dt", term), tag("dd", told)]) for term, told in pairs.items()))


def _all_numbers(column: "pd.Series[Any]") -> bool:
    if pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column):
        return True
    return bool(len(column)) and all(str(each)[:1] in "0123456789+-." for each in column)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "" if pd.isna(value) else f"{value:.6g}"
    return "" if value is None else str(value)
