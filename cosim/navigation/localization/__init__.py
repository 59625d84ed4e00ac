"""Monte Carlo localisation: where a robot is on a known map, from odometry and range scans.

``localizer.Localizer`` is the filter of one robot, and where to begin. Its steps stand by themselves: ``motion`` moves
particles as odometry says, ``likelihood`` compares a scan with the map, and ``resampling`` draws the survivors, counts
how many are needed and finds the heaviest cluster. ``cosim.navigation.slam`` uses the motion model and the resampling
too.
"""
