"""What the experiments with goal reflection (paper 000) share; no experiment by itself.

``reflecting`` makes one run on one of two floors by a team of one of two sizes. ``tables`` has what the paper prints in
Tables 1 and 2 and the names that all figures use. The experiments are the folders ``reflection_*``; begin with
``reflection_tables``.
"""
