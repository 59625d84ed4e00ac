"""Coverage algorithms: how one robot chooses its next step, or to stay.

``base`` holds the contract ``Algorithm`` and the verdicts on the four steps that all algorithms share: begin there.
``random_walk`` is the baseline, ``oscard`` the algorithm of paper 003, and ``planned`` holds the two complete ones,
which follow tours from ``protocols.pseudonet.plans`` and make room for each other.
"""
