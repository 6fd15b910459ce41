"""EXIF as a camera writes it."""

from PIL import ExifTags, Image


def exif_of(*, orientation: int = 1, **tags: float) -> Image.Exif:
    """Return EXIF of these tags; Pillow writes none into a PNG that has no orientation."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    exif.get_ifd(ExifTags.IFD.Exif).update({ExifTags.Base[name].value: value for name, value in tags.items()})
    return exif
