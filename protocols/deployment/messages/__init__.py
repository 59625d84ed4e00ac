"""What robots of a deployment send to each other, as values and as bytes.

``messages`` are sent to one robot, reliably, as JSON: plans, facts, orders, yield requests and pictures. ``status`` is
what a robot broadcasts periodically about itself, in one short frame; only the latest one counts.

:mod:`protocols.transport` carries both; :mod:`protocols.deployment.runner` passes on what arrives.
"""
