"""Statistics of replicates: pure functions of arrays, for sweeps that decide when to stop and for reports.

Begin with ``intervals``: the mean with its 95 % confidence interval, by Student's t over seeds, a share with Wilson's,
paired differences, the BCa bootstrap. ``equivalence`` says what an interval decides about a bound, and how many
replicates would decide it; ``stopping`` how many a sweep is to make; ``designs`` which settings it is to try;
``digits`` writes numbers for people.
"""
