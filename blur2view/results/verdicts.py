"""The configurations in plain words, as the report and the summaries have them."""

from blur2view.geometry.two_view_geometry import Configuration, Parallax, TwoViewGeometry

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
    Configuration.PLANAR_OR_PANORAMIC: (
        "flat",
        "A plane or a rotation explains the smears: no F, but a homography.",
    ),
    Configuration.PLANAR: ("flat", "One plane explains the smears: no F, but a homography."),
    Configuration.PANORAMIC: ("flat", "The camera only turned: no F, but a homography."),
    Configuration.DEGENERATE: ("none", ""),  # the reason says what is missing
    Configuration.UNDEFINED: ("none", ""),
}
UNDECIDED = {
    Configuration.PANORAMIC: "The camera turned; whether it also moved is undecided (F is given, and H).",
    Configuration.PLANAR: "The camera moved, past something flat or too little to tell (F is given, and H).",
    Configuration.PLANAR_OR_PANORAMIC: "The camera turned, or moved past something flat (F is given, and H).",
}
HEADLINES = {
    Configuration.CALIBRATED: "The camera moved",
    Configuration.UNCALIBRATED: "The camera moved",
    Configuration.MULTIPLE: "Several motions",
    Configuration.PLANAR_OR_PANORAMIC: "Turned, or moved before something flat",
    Configuration.PLANAR: "Moved before something flat, or a little",
    Configuration.PANORAMIC: "The camera turned",
    Configuration.DEGENERATE: "No motion",
    Configuration.UNDEFINED: "Cannot tell",
}
VERDICT_ORDER = [config.name for config in VERDICTS]


def headline(geometry: TwoViewGeometry) -> str:
    """Return what a configuration means, in a few words."""
    return "Cannot tell" if geometry.insufficient_data else HEADLINES[geometry.config]


def sentence(geometry: TwoViewGeometry) -> str:
    """Return the one sentence that matters: what the configuration means, or why there is nothing."""
    return verdict(geometry)[1]


def verdict(geometry: TwoViewGeometry) -> tuple[str, str]:
    """Return the kind of a geometry's verdict, and `sentence`."""
    kind, meaning = VERDICTS[geometry.config]
    beside_H = kind == "flat" and geometry.parallax is Parallax.OPEN
    reason = geometry.reason[:1].upper() + geometry.reason[1:]
    return ("open", UNDECIDED[geometry.config]) if beside_H else (kind, meaning or reason)
