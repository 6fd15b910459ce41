"""Take a picture of a report in headless Chromium and say how large it is.

``python -m tools.reports.report_screenshot models/sample.jpg --out tools/results/report.webp``
"""

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from blur2view.cli import commands as cli
from tools.arguments import Existing, Target, run
from tools.pages import write_picture

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = ("--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1280,800")


def main(photograph: Existing, *, out: Target) -> None:
    """Write the picture of a photograph's report as WebP."""
    if (chromium := next(filter(None, map(shutil.which, BROWSERS)), None)) is None:
        raise SystemExit("no Chromium here; apt-get install chromium")
    with tempfile.TemporaryDirectory() as folder:
        report, shot = Path(folder) / "report.html", Path(folder) / "shot.png"
        cli.main(["report", str(photograph), "-o", str(report)])
        words = [chromium, *OPTIONS, f"--screenshot={shot}", report.as_uri()]
        subprocess.run(words, check=True, capture_output=True)
        print(f"{report.stat().st_size / 1e6:.2f} MB")
        with Image.open(shot) as shown:
            write_picture(out, np.asarray(shown.convert("RGB")))


if __name__ == "__main__":
    run(main)
