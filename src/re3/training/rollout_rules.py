"""When a roll-out may go on from its own prediction, and from what it can learn."""

HIDDEN = 0.2
"""An object of which less than this share is visible counts as hidden."""

REACH = 0.9
"""A prediction is put back on the truth once the true centre is this near the crop's border."""

SWELL = 4.0
"""... or once its area is off by this factor."""

READABLE = 0.6, 12.0
"""Sides of the true box, in regression units, between which a lost track can learn from it: the
crop is 10 wide, and one cell of the heat maps 0.4."""
