"""Statistics of replicates: pure functions of arrays, for sweeps that decide when to stop and for reports.

Begin with ``intervals``: the mean with its 95 % confidence interval, by Student's t over seeds, and a share with
Wilson's. ``equivalence`` says what an interval decides about a bound, and how many replicates would decide it.
"""
