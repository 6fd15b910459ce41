"""Cameras: intrinsics, lenses, pixel conventions, what EXIF says of them."""
