"""The rows of the array that holds the state and the limits of all bodies of a run, a column a body.

One array, because what a kernel is given costs time by the array. Ways and turns are per tick, in metres and radians;
flags are 0 or 1.
"""

from typing import Final

X: Final = 0  # at the last tick
Y: Final = 1
HEADING: Final = 2
SPEED: Final = 3  # m/s, signed, of the interval that ended
ARRIVED: Final = 4
BLOCKED: Final = 5  # the interval that ended was cut
OBSERVED: Final = 6  # so many rows are what a body observes
WAY: Final = 6  # signed length of the path until the next tick, cut at contact
TURN: Final = 7
NEXT_X: Final = 8  # at the next tick
NEXT_Y: Final = 9
GOING: Final = 10  # there is a point to go to; else the wanted way and turn count
GOAL_X: Final = 11
GOAL_Y: Final = 12
WANTED_WAY: Final = 13
WANTED_TURN: Final = 14
LANDING: Final = 15  # the goal is reached at the next tick
CUT: Final = 16  # the way until the next tick has been cut
ROOM: Final = 17  # of its centre to walls, at least, or below 0: see contact.cut
DX: Final = 18  # the straight way until the next tick, before it is cut
DY: Final = 19
PART: Final = 20  # of it that can be gone
RADIUS: Final = 21
MOST_WAY: Final = 22
WAY_CHANGE: Final = 23
MOST_TURN: Final = 24
TURN_CHANGE: Final = 25
TURNS_FIRST: Final = 26
SECONDS: Final = 27  # of a tick
ANY_WAY: Final = 28  # it may change its direction as it drives
FROZEN: Final = 29  # it brakes, then stands, whatever it was told
GUIDED: Final = 30  # it follows a path, whatever is in its way
ROWS: Final = 31
