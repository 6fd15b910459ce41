"""``python -m blur2view``."""

import sys

from blur2view.cli.commands import main

sys.exit(main())
