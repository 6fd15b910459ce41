"""The errors a user may meet; each message is one line that names the path and the remedy."""


class Blur2ViewError(Exception):
    """Something outside the program is wrong; the message says what, where and how to mend it."""


class ImageError(Blur2ViewError):
    """An image file cannot be used."""


class ModelError(Blur2ViewError):
    """A network file cannot be used."""


class OutputError(Blur2ViewError):
    """A result cannot be written."""


class CameraError(Blur2ViewError):
    """A camera's intrinsics cannot be used."""


class DatabaseError(Blur2ViewError):
    """A COLMAP database or model cannot be read or written."""
