"""The papers' experiments, each a folder: a scenario, what varies in it, and what the paper printed beside it.

``sweep.yaml`` names the runs and is where to begin; ``published.csv`` holds the paper's numbers and claims,
``README.md`` what was chosen where the paper is silent, ``figures.py`` claims and pictures of its own.
``pseudonet_coverage`` is the plainest. No experiment imports another: what several of one paper share is in a folder
without a sweep.yaml (``aggregation``, ``deployment``, ``exploration``, ``radio``, ``reflection``, and ``floors`` with
the maps).

Users have folders of this name too: theirs extend ours, so that ``experiments.mine`` is found beside these.
"""

from pkgutil import extend_path

__path__ = extend_path(__path__, __name__)
