"""The document of ``blur2view to-colmap``."""

from dataclasses import dataclass

from blur2view.results.document import Document


@dataclass(frozen=True, kw_only=True)
class ViewsDocument(Document):
    """The two virtual images of one photograph."""

    image: str
    """The photograph as it was named."""
    name: str
    """Its name in the database."""
    views: tuple[str, str]
    """The names of its views, NAME#open and NAME#close."""
    action: str
    """add, or replace (with --replace)."""
    config: str
    """The configuration, a name of COLMAP's TwoViewGeometryConfiguration."""
    parallax: str
    """proven, undecided or absent."""
    reason: str
    """One sentence with the figures that decided."""
    num_keypoints: int
    """Keypoints of each view: both ends of the smears, or with --link the features moved."""
    num_matches: int
    """Keypoints that are matched between the views."""
    num_inliers: int
    """Matches that fit the two-view geometry."""
    translation_known: bool
    """Whether the camera is known to have moved: parallax is proven, or the direction known to 30 degrees.
    Without --link COLMAP gets no inliers of the others, so that it makes no points from a rotation."""
    time_known: bool
    """Whether neighbouring photographs decided which view came first; else open and close may be exchanged.
    """
    time_confidence: float
    """How sure that decision is, 0 to 1."""


@dataclass(frozen=True, kw_only=True)
class ToColmapDocument(Document):
    """What ``blur2view to-colmap --json`` prints."""

    target: str
    """The database that was written."""
    dry_run: bool
    """Whether nothing was written, see --dry-run."""
    backup: str | None
    """The copy of the database from before, with --link."""
    photographs: list[ViewsDocument]
    """One object per photograph that was written, see below."""
    kept: list[dict[str, str]]
    """Photographs whose views are in the database already: image, name."""
    failures: list[dict[str, str]]
    """Photographs that failed: image, error."""
