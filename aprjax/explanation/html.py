"""Pieces of a page that is one file: no script, nothing from elsewhere, all text escaped."""

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape

from matplotlib.artist import Artist

from aprjax.plot.style import figure_of

_DPI = 80

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; margin: 2em auto; max-width: 76em;
       padding: 0 1em; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 2em; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .2em .7em; text-align: right; border-bottom: 1px solid #ddd; }
th { font-weight: 600; vertical-align: bottom; } td.text, th.text { text-align: left; }
figure { margin: 0; } figcaption { font-size: .9em; color: #555; }
img { max-width: 100%; height: auto; }
.wide { overflow-x: auto; }
.pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(30em, 1fr)); gap: 1.5em;
            align-items: start; }
"""


def document(title: str, body: str) -> str:
    """The whole page, which the browser is told to fetch nothing for."""
    head = (
        '<meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "img-src data:; style-src 'unsafe-inline'\">"
        f"<title>{escape(title)}</title><style>{_STYLE}</style>"
    )
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'


def picture(drawn: Sequence[Artist], caption: str) -> str:
    """A picture with its caption; the bytes are in the page."""
    buffer = io.BytesIO()
    figure_of(drawn).savefig(
        buffer, format="png", dpi=_DPI, bbox_inches="tight", metadata={"Software": None}
    )
    data = base64.b64encode(buffer.getvalue()).decode()
    text = escape(caption, quote=True)
    return (
        f'<figure><img alt="{text}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )


def section(title: str, pictures: Iterable[str]) -> str:
    """Pictures side by side under a heading; nothing where there are none."""
    inside = "".join(pictures)
    return f"<h2>{escape(title)}</h2><div class=pictures>{inside}</div>" if inside else ""


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], words: str | None = None) -> str:
    """A table of numbers, but for the column under the head `words`."""
    kinds = [' class="text"' if head == words else "" for head in heads]

    def line(cells: Sequence[str], tag: str) -> str:
        inner = (
            f"<{tag}{kind}>{escape(cell)}</{tag}>" for kind, cell in zip(kinds, cells, strict=True)
        )
        return f"<tr>{''.join(inner)}</tr>"

    body = "".join(line(row, "td") for row in rows)
    return f"<table><thead>{line(heads, 'th')}</thead><tbody>{body}</tbody></table>"
