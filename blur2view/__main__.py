"""``python -m blur2view``."""

import sys

from blur2view.cli import main

sys.exit(main())
