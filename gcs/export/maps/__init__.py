"""Places of boxes on the ground, for maps: boxes as points, and what each vehicle did as lines.

Lines are of those boxes that a track took and that have a place; a line ends where nobody saw the vehicle for a while.
"""
