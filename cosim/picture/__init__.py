"""Pictures of a run: the floor above, the slots of its radios below, both at the same time.

``moment`` is where to begin: a figure of an instant, for a paper. ``film`` draws one after the other, ``page`` writes
one HTML file that shows the whole run without a server. ``window`` says which boxes are seen between two times,
``floor`` and ``slots`` draw them with matplotlib, and ``colours`` tells kinds apart, in grey too.
"""
