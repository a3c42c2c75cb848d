"""Values of the occupancy layer beside 0, which is free or unknown. It needs no package, since clients draw maps, too."""

from __future__ import annotations

#: A sensor measured an obstacle, or a camera without a depth sensor estimated one.
OBSTACLE, ESTIMATED_OBSTACLE = 1, 2
#: Where no view has shown anything else: a map that was there before has an obstacle, or free floor that nobody has looked at.
PRIOR_OBSTACLE, PRIOR_FREE = 3, 4
