"""Plane geometry for worlds, robots and protocols: walls as segments, floors as cells, and ways over them.

``segments`` has walls in a uniform grid, for rays, lines of sight and clearances; ``boundary`` walks along them as a
disc does. ``grids`` has the cells that a team covers, ``marking`` the evidence grid that scans are marked into, with
its frontiers.

Ways: ``planning`` is where to begin (free cells, the wavefront, way points); ``value_iteration`` adds prices, ``astar``
a goal and an estimate, all three by the search of ``grid_search``. ``roadmap`` finds ways between corners of obstacles,
``polylines`` measures ways. All of it is pure functions, most of them numba kernels.
"""
