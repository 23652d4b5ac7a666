"""The entry point: one scan in, one page out."""

from collections.abc import Sequence

from aprjax.explanation.stages import account
from aprjax.matcher import MatchConfig
from aprjax.references import ReferenceSet
from aprjax.scan import Scan


def explain(
    scan: Scan,
    references: ReferenceSet,
    config: MatchConfig | None = None,
    *,
    exclude: Sequence[int] = (),
    about: Sequence[int] = (),
    title: str = "Why this reference, and why not that",
) -> str:
    """An HTML page that tells how one scan was matched: why this reference, and why not that.

    It holds the scan with its anchors, the hypotheses as a table and laid over their references,
    what speaks for the best of them, and how far the other references got. `about` are ids of
    references to be told of in any case, `exclude` as in `match`. The page is one piece: no
    script, no other file, nothing from a network. The engine's stages are run once more, which
    compiles anew for the first page. Raises `ValueError` as `match` does, and for an id in `about`
    that no reference has.
    """
    # Who draws nothing does not wait for matplotlib.
    from aprjax.explanation.page import page

    for position, value in enumerate(about):
        if value not in references.ids:
            raise ValueError(f"about[{position}]: no reference has id {value}")
    config = MatchConfig() if config is None else config
    told = account(scan, references, config, exclude)
    return page(told, scan, references, config, about, title)
