"""Two-view geometry of smears whose ends have no order.

To be read in this order: `constants`; `models` (F of a camera, any F) and `homography` (rotations, planes);
`likelihood`, by which all of them are judged; `ransac`, `levenberg_marquardt` and
`reweighted`, which know no geometry; `search`, `fit_fundamental` and `fit_homography`; `consensus` (what is
refused, inliers) and `choice` (which model); `pose` of known intrinsics and `order` of the ends; `estimate`,
which calls them.
"""
