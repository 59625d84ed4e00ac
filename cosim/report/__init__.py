"""What a sweep found: tables, figures, and our numbers beside those that a paper printed.

``sweep_report`` is where to begin: ``report(folder)`` computes what ``cosim report`` prints. It reads an experiment's
``published.csv`` (``claims``, with the columns of that file) and calls its ``figures.py`` (``figures_module``).
``experiment_page`` makes a page of it, ``reproduction`` runs all experiments and writes an index over all claims.

The other modules are for such a figures.py. ``estimates`` has means with confidence intervals. ``comparison`` has
paired tests between a sweep's arms, which answer a claim. ``drawing`` has the usual figures, and parts of others;
``saving`` writes a figure and its numbers; ``cosim.experiment.axis_titles`` what figures call the values of axes.

``differences`` compares two sweeps or two arms of one (``cosim compare``), ``sensitivity`` tells which axis matters.
``by_choice`` judges the claims once for each value of an axis ``choice``:
``python -P -m cosim.report.by_choice RESULTS``; ``by_chance`` tells how many verdicts chance would turn. ``kept`` reads
and writes what is kept beside a published.csv, and ``claims_page`` makes docs/claims.md of it.
"""
