"""The configurations in plain words, as the report and the summaries have them."""

from blur2view.geometry.two_view_geometry import Configuration, TwoViewGeometry

# Configuration -> kind of verdict (its colour and place in the order) and what it means, in plain words.
VERDICTS = {
    Configuration.CALIBRATED: (
        "found",
        "The camera moved past things at different depths: F, E and the pose are given.",
    ),
    Configuration.UNCALIBRATED: ("found", "The camera moved past things at different depths: F is given."),
    Configuration.MULTIPLE: (
        "open",
        "Two motions share the picture: F is that of the one most smears follow.",
    ),
    Configuration.PLANAR_OR_PANORAMIC: ("open", "It is open whether there is parallax."),
    Configuration.PLANAR: ("flat", "One plane explains the smears: no F, but a homography."),
    Configuration.PANORAMIC: ("flat", "The camera only turned: no F, but a homography."),
    Configuration.DEGENERATE: ("none", "There is no motion to estimate from: no F."),
    Configuration.UNDEFINED: ("none", "No F explains the smears better than chance: none is given."),
}
UNPROVEN = "The camera moved: F is given, but that things lie at different depths is not proven."
VERDICT_ORDER = [config.name for config in VERDICTS]


def verdict(geometry: TwoViewGeometry) -> tuple[str, str]:
    """Return the kind of a geometry's verdict, and what its configuration means in one sentence."""
    kind, meaning = VERDICTS[geometry.config]
    return kind, UNPROVEN if kind == "found" and geometry.H is not None else meaning
