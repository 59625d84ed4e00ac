"""An IEEE 802.11 ad hoc network: one station for each robot, all on one medium, with routing if it is asked for.

Begin with ``channel``, which joins the parts, and ``dcf``, the distributed coordination function of one station.
``mac`` has the frames and times that stations share, ``phy`` the physical layers and their air times, ``air`` the
medium that carries frames from one station to others. ``reception`` decides what a station receives of all that
arrives, ``errors`` how probably its bits are right, ``jamming`` what jammers add.

``settings`` are the parameters of a scenario. ``forwarding`` drives the routers, which are in the package ``routing``.
"""
