"""HTML in which every text is escaped: what is not ``Html`` already becomes so where it is put in."""

import re
from collections.abc import Sequence
from html import escape
from typing import Any, Final
from urllib.parse import quote

_VOID: Final = {"meta", "br", "img"}
"""Elements that have no end."""
_SCROLLING: Final = 'tabindex="0" role="group" aria-label'
_ABROAD: Final = re.compile(r"https?://")


class Html(str):
    """Markup that is safe to be put in as it is."""

    __slots__ = ()


def tag(name: str, /, *children: object, **attributes: object) -> Html:
    """Return the element *name* with *children*, of which those that are no Html are escaped.

    A trailing ``_`` of an attribute's name is left out, another becomes ``-``. An attribute that is None or False is
    left out, one that is True has no value.
    """
    words = [name]
    for key, value in attributes.items():
        if value is None or value is False:
            continue
        called = key.rstrip("_").replace("_", "-")
        words.append(called if value is True else f'{called}="{escape(str(value))}"')
    start = Html(f"<{' '.join(words)}>")
    return start if name in _VOID else Html(f"{start}{joined(children)}</{name}>")


def joined(parts: Sequence[object], between: str = "") -> Html:
    """Return *parts*, escaped where they are no Html, one after the other."""
    return Html(escape(between).join(part if isinstance(part, Html) else escape(str(part)) for part in parts))


def identifier(*words: object) -> str:
    """Return an id for an element, or a fragment of an address, that *words* make, the same for the same words."""
    return "-".join(quote(str(word), safe="").replace("%", "_") for word in words)


def markdown(text: str) -> Html:
    """Return *text*, Markdown, as HTML: no markup of its own, no pictures, and links to addresses of the web only."""
    from markdown_it import MarkdownIt

    reader = MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")
    reader.add_render_rule("link_open", _link)
    # what is wider than a phone scrolls by itself, also by keys
    reader.add_render_rule("table_open", lambda *_: f'<div class="wide" {_SCROLLING}="table"><table>')
    reader.add_render_rule("table_close", lambda *_: "</table></div>")
    reader.add_render_rule("code_block", _code)
    reader.add_render_rule("fence", _code)
    return Html(reader.render(text))


def first_section(text: str) -> str:
    """Return what stands in *text*, Markdown, before its second heading, without the first one if it begins with it."""
    from markdown_it import MarkdownIt

    lines = text.splitlines(keepends=True)
    heads = [token.map for token in MarkdownIt("commonmark").parse(text) if token.type == "heading_open" and token.map]
    begins = [0, *(end for _, end in heads)]
    ends = [*(begin for begin, _ in heads), len(lines)]
    parts = ("".join(lines[begin:end]) for begin, end in zip(begins, ends, strict=True))
    return next((part for part in parts if part.strip()), "")


def _code(renderer: Any, tokens: Any, index: int, options: Any, env: Any) -> str:
    return f'<pre {_SCROLLING}="code"><code>{escape(tokens[index].content)}</code></pre>'


def _link(renderer: Any, tokens: Any, index: int, options: Any, env: Any) -> str:
    """Return the start of a link; what is no address of the web is beside the source, not beside this page."""
    href = str(tokens[index].attrGet("href") or "")
    return f'<a href="{escape(href)}">' if _ABROAD.match(href) else "<a>"
