"""Every constant of search, likelihood, choice of models and pose, with the command and the data behind it.

Sources, where a line says no other: RK, 34 frames of RedKitchen (`score_redkitchen.py`, in the history);
KINDS, rendered photographs of known motion (`python -m tools.datasets.testset OUT --kinds --seed N`, then
`python -m tools.evaluation.degeneracy --kinds OUT`); SYNTH, `python -m tools.evaluation.degeneracy` without
photographs. "Bound": any number nearby would do.
"""

from blur2view.geometry.configuration import MotionModel

# The camera that is assumed.
BEHIND = 0.2  # probability that noise puts a point behind a camera that is before it: bound
# Focal length over the longer side of the image. Any value from 0.4 to 0.6 does as well on 35 rendered scenes
# (focal lengths of 0.6 to 1.6) and RK (0.82); 0.85 and 1.2 raise the mean rho of both by a sixth and by more
# than half. At a short focal length the fields of rotations are curved, which tells them from translations;
# at a long one hardly, so that errors decide, and rolling shutters bend fields likewise. Not even the true
# focal length in its place does better (mean rho 0.069, 0.057 and 0.105 on 60 and 40 rendered scenes and RK,
# with this 0.067, 0.052 and 0.074).
ASSUMED_FOCAL = 0.55
# Prior standard deviations of the rotation about x, y and z, in the median smear's length over the focal
# length; one about z moves points less.
ROTATION_SPREAD = 1.0, 1.0, 3.0
# Prior standard deviations of the log focal length over the assumed one and of the principal point in focal
# lengths; then the same without an image size, with which 104 scenes of the sweep have an AUC@10 of 0.825, as
# with it, and 91 % of 118 scenes of SYNTH are named rightly.
LENS_SIGMA, UNSIZED_LENS_SIGMA = (0.3, 0.03), (0.9, 0.09)

# The likelihood of F.
CUTOFF = 3.0  # residual, in standard deviations, at which a smear is as likely an outlier as an inlier
OUTLIER_ODDS = 0.5  # of a smear; an outlier's residual is uniform between -+ its length / sqrt(2)
LENGTH_ERROR = 0.1  # share of the length, added in quadrature to the error along a smear, for depth
ROUGH_COUNT = 350  # smears, at least, from which rough fits and the scale of the noise are taken: bound
MIN_INDEPENDENT = 100.0  # independent smears that measure the noise; a network gives at most about 100
# Share of independent smears at which the logarithm of the orders' odds by depth counts half: errors that
# neighbours share mislead about depth as they do about F (rendered, one smear in thirty independent: median
# rho 0.049 with full odds, 0.039 with these).
DEPTH_TRUST = 0.25

# The likelihood of displacement fields.
FREEDOM = 4.0  # degrees of freedom of Student's distribution of the residuals
PARALLAX_WIDTHS = 1.5, 4.0, 12.0, 40.0  # of displacements by parallax, in standard deviations of a smear
WIDER = 3.0  # by which errors that are worse than stated are larger: they are no parallax
MIXTURE_ROUNDS = 50  # of expectation-maximisation: bound
NO_ERROR = 1e-9  # standard deviation that holds a slowly varying error at zero
FIELD_STEPS, FIELD_TOLERANCE = 12, 1e-3  # Levenberg-Marquardt steps, and the relative decrease that ends them
PLANE_STEPS = 8  # of reweighting, for a start
FIELD_STARTERS = 3, 3, 2  # starts that take a step, a second, a third
# Prior standard deviation of a rotation's change per focal length of height, over that of the rotation.
ROLLING_SPREAD = 0.5

# Search and fits of F.
WIDE, SEARCH_STEPS = 3.0, 3  # factor of sigmas in the first of two fits inside the loop; their steps: bound
SEARCH_TOLERANCE = 1e-2  # relative decrease of the cost that ends them: bound
# Translations tried with every sample of three. Of 48 scenes of `test_estimate`'s dominant planes
# three have an epipole more than 2 degrees off; with 60 directions five.
SEARCH_DIRECTIONS = 80
STEPS = 12  # Levenberg-Marquardt steps; fits start near their end: bound
# Step, in standard deviations, below which a fit ends; with 0.2, F depends on the order in which ends are
# given.
MIN_STEP = 0.02
# Starts that take a first, a second, a third and a fourth step; then the cheapest alone goes on. With 3 and
# 2, 3 of 120 exact scenes (`test_estimate`) end in another minimum.
STARTERS = 5, 5, 5, 2
TOLERANCE = 1e-5  # relative decrease of the cost that ends a fit
SCALE_STEPS = 8  # of expectation-maximisation, for the scale of the noise: bound
MIN_VARIANCE = 1e-6  # of residuals, over that stated: those of exact smears are zero
PAIRS = 100  # pairs of smears tried for a start of the two-parameter F: bound

# Refusals and inliers: `two_view.estimate`.
MIN_SMEARS = 20
MIN_WIDTH = 0.01  # spread of the midpoints across over along the line that fits them
BLOCKS, MIN_COVERAGE = 12, 0.08  # square blocks along the longer side; share of them that hold matches
INLIER_SHARE = 0.1  # Sampson distance over length, from which smears are outliers: rho, our main measure
INLIER_SIGMAS = 2.0  # standard deviations of its Sampson distance, within which any smear is an inlier
MIN_AGREEMENT = 0.2  # share of smears that fit F beyond chance; by SYNTH's last row and fields of noise

# Which model: `two_view.choice`.
SAMPLE = 1000  # smears that models are compared on, at most: with 400, 3 of 14 general SYNTH are open, not 1
ON_PLANE = 3.0  # standard deviations within which a smear follows a homography
MIN_ON_PLANE = 0.4  # share of the smears on it without which parallax is not called absent
# The one step from the table to probabilities (`choice.model_probabilities`): by maximum likelihood over 200
# rendered photographs of rotations, planes, still cameras and parallax of a fifth
# (`tools.datasets.testset OUT --kinds --scenes 50 --seed 80000`, network smears). Rolling shutters pay
# the same beside any field: smears that were bent down the rows by 5 to 40 % ask for 2.5 and 2.7. In that is
# log 2, as rows are rows or, of a picture that was turned upright, columns.
MODELS = {  # parameters, and penalty beside Schwarz's
    MotionModel.STILL: (0, 0.0),
    MotionModel.ROTATION: (3, 0.0),
    MotionModel.PLANE: (8, 2.7),
    MotionModel.PARALLAX: (10, 3.7),
}
ROLLING = 3, 3.0  # parameters and penalty that a rolling shutter adds to a model
PENALTY_COUNT = 6.0  # independent smears, all correlation counted, of the photographs that these fit
# Probability of parallax: of the 200, two of the 150 others reach it, of the 50 that have it 18.
PROVEN_FROM = 0.87
# Share of the smears that must follow F beyond chance, too: in `tools.datasets.synthetic_matches`, seeds 0 to
# 39, 0.32 to 0.38 of smooth random fields do, 0.54 and more of a camera's motion. Of fields correlated over
# 120 px (`tests/two_view/test_degeneracy.py`) eight of 36 (seeds 0, 100 and 200 to 11 more) reach it, with
# 0.5 eleven. Nor does the share within thrice the tolerance tell them from a camera's motion.
PROVEN_AGREEMENT = 0.55
# Probability of parallax below which it is absent, where MIN_INDEPENDENT smears are independent, all
# correlation counted: bound
ABSENT_BELOW = 0.015

# The pose of known intrinsics: `two_view.pose`.
GRID, GRID_STEP_DEG = 400, 4.5  # directions of translation over half a sphere, and their distance
# Smears looked at, or up to twice as many: with 200 of them 2 of 92 exact scenes (`test_estimate`) end
# in another minimum of F, with 300 none; steps of reweighting: bound
GRID_SMEARS, GRID_STEPS = 300, 6
# Likeliest directions that start fits of F, and the cosine of the angle between any two. With 3, AUC@10 of
# the sweep is 0.848, with 1 0.843.
GRID_STARTS, GRID_APART = 3, 0.9
GRID_PARTS = 4  # parts of the directions, each of which a cache holds; all at once take a third longer: bound
GRID_ROTATION_SPREAD = 3.0  # prior deviation of the rotation, in lengths of smears: bound
KNOWN_DEG = 30.0  # deviation of its direction below which a translation is given
# The one sentence of it: `Record.cam2_from_cam1` and `blur2view to-colmap --json` say it to users.
TRANSLATION_RULE = f"zero where neither parallax is proven nor its direction known to {KNOWN_DEG:g} degrees"
# By which the inverse normal matrix is multiplied: squared errors over those that it states. With 4 the
# nominal 90 % regions of `tools.evaluation.pose_coverage` hold the truth in 87 to 100 % of 60 seeds.
COVARIANCE_FACTOR = 4.0
# Deviation, in lengths of smears, of a rotation beside a translation that may account for any part of them:
# past things at one depth, or on a slope.
UNSEEN = 0.5
