"""Plans: tours over all cells of a floor, divided among the team; every robot computes the same one.

``tours`` holds what a tour is, what it costs and how it is divided: begin there. ``spanning_tree`` and
``boustrophedon`` are two ways to make one. All are pure functions of the cells; they know no robot and no message.
"""
