"""Makes the pictures of gallery.md by commands: `python docs/gallery.py [FOLDER]`.

Two minutes. Screenshots need Chromium; without one they are left as they are, and that is said. The arm in
space is of the package example-robot-data (`pip install '.[test]'`).
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images" / "gallery"
UR10 = ROOT / "examples" / "ur10"
TABLE = """
[[box]]
name = "table"
centre = [0.6, 0.3, 0.15]
size = [0.5, 0.6, 0.3]
"""


def commands(images: Path) -> list[list[str]]:
    """What makes each picture, in turn, in an empty folder."""
    etude = [sys.executable, "-m", "etude"]
    draw = "import etude, sys; etude.open_campaign(sys.argv[1]).plot(sys.argv[2])"
    look = "import etude, sys; etude.read_log(sys.argv[1], etude.open_campaign('lab')).plot(sys.argv[2])"
    add = "import sys; open('desk/robot.toml', 'a').write(sys.argv[1])"
    files = distribution("example-robot-data")
    robots = str(files.locate_file("cmeel.prefix/share/example-robot-data/robots"))
    panda = f"{robots}/panda_description/urdf/panda.urdf"
    return [
        [*etude, "init", "lab", "--robot", "arm4_rough"],
        [*etude, "simulate", "lab", "--rounds", "3"],
        [*etude, "report", "lab"],
        [sys.executable, "-m", "etude.report.pictures", "lab", str(images / "learning_rough.svg")],
        [*etude, "init", "sky", "--robot", "quadrotor_rough"],
        [*etude, "simulate", "sky", "--rounds", "2"],
        [sys.executable, "-c", draw, "sky", str(images / "learning_quadrotor.svg")],
        [*etude, "inspect", str(UR10 / "ur10_exciting.csv"), "--picture", str(images / "inspected.svg")],
        [sys.executable, "-c", look, "lab/simulated/0001.parquet", str(images / "log.svg")],
        [*etude, "study", "report", "--output", "pages"],
        [*etude, "init", "desk", "--robot", panda, "--joints", "panda_joint?", "--mesh-root", robots],
        [sys.executable, "-c", add, TABLE],
        [*etude, "ask", "desk", "--from", "home"],
        [*etude, "view", "desk"],
    ]


def photographs(images: Path, folder: Path) -> list[list[str]]:
    """What is photographed in a browser: page of that folder, window and file."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        return []
    start = [browser, "--headless=new", "--no-sandbox", "--hide-scrollbars", "--virtual-time-budget=4000"]
    shots = (
        ("lab/report.html", 1280, 1500, "report.png"),
        ("pages/table-6.9.html", 1280, 1100, "study.png"),
        ("desk/view.html#t=30.7", 1280, 1230, "view.png"),
    )
    return [
        [
            *start,
            f"--window-size={width},{height}",
            f"--screenshot={images / name}",
            f"file://{folder}/{page}",
        ]
        for page, width, height, name in shots
    ]


def main(images: Path) -> None:
    """Runs all of it; an exit code that is not 0 ends it."""
    images.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:
        pictures = photographs(images, Path(folder))
        for command in [*commands(images), *pictures]:
            subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    if not pictures:
        sys.stderr.write("There is no browser: report.png, study.png and view.png are as they were.\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else IMAGES)
