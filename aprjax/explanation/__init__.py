"""Why a query was answered as it was: a page for one scan, with pictures.

`aprjax.explain` writes it. What it tells comes from the stages of the engine itself, run once more
for this query (`aprjax.explanation.stages`).
"""
