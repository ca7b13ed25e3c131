"""Statistics of the members of a result, with intervals.

Reading order: `measures` ("p(flips >= 1)"), `estimates` (of
existing results), `intervals` (of probabilities, means, quantiles), `spread` (means and quantiles
in bounded memory), `sums` (means of blocks in any order), `censored` (times of events that have not
occurred; variables by name).

Flagged members are counted, never dropped silently.
"""
