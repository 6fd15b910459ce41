"""Why a geometry has its configuration, in words: the only place where its facts become sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blur2view.geometry.configuration import Cause, Configuration, Parallax

if TYPE_CHECKING:
    from blur2view.geometry.configuration import Refusal, Support
    from blur2view.geometry.two_view_geometry import TwoViewGeometry


def explanation(geometry: TwoViewGeometry) -> str:
    """Return one sentence with the figures that decided on the configuration of a geometry."""
    refusal, support = geometry.refusal, geometry.support
    parts = [_conclusion(geometry) if refusal is None else _refusal(refusal)]
    if support is not None:
        parts.append(_support(support))
    parts += _pose(geometry)
    if geometry.one_way:
        parts.append("the rolling shutter excludes the other order in time")
    return "; ".join(parts)


def _refusal(refusal: Refusal) -> str:
    """Return why no model was fitted."""
    value, limit = refusal.value, refusal.limit
    match refusal.cause:
        case Cause.FEW_SMEARS:
            return f"too few smears: {value:.0f} remain, but {limit:.0f} are needed"
        case Cause.SHORT_SMEARS:
            return f"no motion: the median smear is {value:.2f} px long, which is below {limit:.2f} px"
        case Cause.SMALL_PART:
            cover = f"the smears cover {100 * value:.0f} % of the image, and {100 * limit:.0f} % are needed"
            return f"{cover}; perhaps one object moves before a still camera"
        case Cause.ONE_LINE:
            return "all smears lie along one line, which determines neither F nor H"
        case Cause.WITHIN_ERRORS:
            return "no motion: the smears are no longer than their errors"
        case Cause.UNCLEAR:
            return f"cannot tell if the camera moved: {refusal.blur}"
        case Cause.NOT_ASKED_FOR:
            return "no geometry was requested"
    return f"no motion of the camera is seen: {refusal.blur}"


def _conclusion(geometry: TwoViewGeometry) -> str:
    """Return which models explain the smears, with the probability of each."""
    match geometry.config, geometry.parallax:
        case Configuration.UNDEFINED, _:
            conclusion = "no single motion explains the smears"
        case Configuration.DEGENERATE, _:
            conclusion = "no motion"
        case _, Parallax.PROVEN:
            conclusion = "parallax is proven"
        case _, Parallax.ABSENT:
            conclusion = "there is no parallax"
        case _:
            conclusion = "parallax is undecided"
    if geometry.few_follow_F:
        conclusion += " because few smears follow F"
    table = ", ".join(f"{row.model} {row.probability:.2f}" for row in geometry.models)
    return f"{conclusion} ({table})" if table else conclusion


def _support(support: Support) -> str:
    """Return how many smears fit; only all are 100 %."""
    all_fit = support.num_inliers == support.count
    share = 100 if all_fit else min(round(100 * support.num_inliers / support.count), 99)
    return f"{share} % of {support.count} smears fit F, and {100 * support.by_chance:.0f} % would by chance"


def _pose(geometry: TwoViewGeometry) -> list[str]:
    """Return how the pose of known intrinsics was found."""
    pose = geometry.cam2_from_cam1
    if pose is None:
        return []
    if geometry.config is Configuration.PANORAMIC and geometry.H is not None:
        return ["the pose is the rotation that explains the smears alone"]
    has_translation, sentences = bool(pose.translation.any()), []
    if has_translation or geometry.F is not None:
        sentences.append("E was fitted to the known intrinsics")
    if not has_translation:
        sentences.append("the pose is the mean rotation over all directions of translation")
    return sentences
