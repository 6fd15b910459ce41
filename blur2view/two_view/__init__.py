"""Two-view geometry of smears whose ends have no order.

To be read in this order: `constants`; `models` (F of a camera, rotations, planes); `likelihood`, by which all
of them are judged; `least_squares` and `ransac`, which know no geometry; `fundamental` and `homography`,
which search and fit; `choice` (which model); `pose` of known intrinsics and `order` of the ends; `estimate`,
which calls them.
"""
