"""One robot's part in a play: it carries out its orders and reports how they ended.

Begin with ``member``. It drives by a mover (:mod:`protocols.deployment.driving`), takes pictures by its ``camera``, and
knows the ``others`` by what it sees of them and by their status broadcasts.

``yielding`` lets it make room for a robot that passes, and ask a robot that stands in its own way to do so.
"""
