"""How good an alignment is, and choosing thresholds.

# Choosing thresholds

The defaults are one set for all buildings and scanners of the README's tables. Before changing
one, know which question it answers.

*May the robot act on the answer?* `MatchResult.confident` says so: the best quality, e_m less what
rivals cost, reaches `MatchConfig.confident`, and no rival explains the scan about as well.

```python
>>> import aprjax
>>> print(aprjax.MatchConfig().confident)
0.18

```

Set it by what a wrong answer costs. With a log whose true poses are known, match it, and take the
most generous threshold of which at most a given share is wrong (`aprjax.metrics.best_answers` and
`aprjax.metrics.Answers.accepted`, as `experiments/real_logs.py` does). e_m is a number of agreement
and no probability, but grows with it: a log of one building serves others of the kind. For a robot
that collects evidence while it drives, `MatchResult.probability` is the better measure, and
`aprjax.HypothesisTracker` uses it. Its curve (`aprjax.evaluation.probability`) was fitted where a
quarter of the scans were of floors that no reference showed: where more of them are, the
probability is too high. `aprjax.plot.reliability.draw_reliability` shows how far it holds.

*Which hypotheses are worth returning?* `MatchConfig.min_quality`; zero by default, since the caller
sees their qualities. A best answer below it is not returned, and not confident: the status is then
`below_threshold`. Nothing changes for those that reach it.

```python
>>> print(aprjax.MatchConfig().min_quality, aprjax.MatchConfig().hypotheses)
0.0 5

```

*When are two answers rivals?* `aprjax.evaluation.distinctiveness`: two places exclude each other
where the references' scans contradict each other, or, with `T_world_ref` given to
`aprjax.ReferenceSet.build`, where the poses differ. Give the poses if there are any: then identical
rooms are told apart by geometry.

*Does the sensor differ?* How far a beam may be off the synthetic scan and still agree with it, in
metres and per metre of range, says `aprjax.evaluation.congruence.CongruenceConfig`; the errors of
range and of the alignment must fit into it. How anchors are found
(`aprjax.anchors.extract.ExtractionConfig`) matters most of all thresholds, as the README's table
shows. Queries and references must be described alike, so that it belongs to the
`aprjax.FeatureConfig` of the set.

Thresholds are array leaves, so that another value compiles nothing:

```python
>>> import equinox as eqx
>>> import numpy as np
>>> config = aprjax.MatchConfig(confident=0.3)
>>> noisy = eqx.tree_at(lambda c: c.congruence.tolerance, config, np.float32(0.12))
>>> print(noisy.congruence.tolerance, noisy.confident)
0.12 0.3

```

`aprjax.configuration.to_dict` lists all of them with their values, and
`experiments/results/defaults.csv` what halving and doubling each does.
"""
