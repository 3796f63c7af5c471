"""Takes the documents' pictures: pictures.py OUTPUT [RAW]

A real Blender in a window of its own plays an artist's session (inside/pictures.py); what it shows
is cropped and written into OUTPUT, in fewer colours where it would be large. RAW keeps the whole
windows.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageChops

sys.path[:0] = [str(Path(__file__).resolve().parents[2] / "clients" / "blender_addon")]

from blenders import DEBIAN, Blender, Window  # noqa: E402

SCREEN = (1280, 960)
SECONDS = 400
LARGE_BYTES = 140_000
HEADER_ROWS = 24  # of a panel, at least


def crop(shot: dict) -> Image.Image:
    """The part of a window that its box names, in pixels from the lower left corner."""
    image = Image.open(shot["file"]).convert("RGB")
    left, bottom, right, top = shot["box"]
    part = image.crop((left, image.height - top, right, image.height - bottom))
    return trimmed(part) if shot["trim"] else part


def trimmed(image: Image.Image) -> Image.Image:
    """As far down as the panel goes: to the first row that is of the background alone."""
    background = Image.new("RGB", image.size, image.getpixel((image.width // 2, image.height - 8)))
    seen = ImageChops.difference(image, background).point(lambda value: 255 * (value > 4))
    for row in range(HEADER_ROWS, image.height):
        if seen.crop((0, row, image.width, row + 1)).getbbox() is None:
            return image.crop((0, 0, image.width, row))
    return image


def save(image: Image.Image, path: Path) -> None:
    """A PNG that a page can hold many of."""
    image.save(path, optimize=True)
    if path.stat().st_size > LARGE_BYTES:
        image.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def take(folder: Path, raw: Path) -> dict[str, dict]:
    """Two Blenders, one daemon: the artist's window, and the tool that shares a session."""
    window, other = Window(folder, SCREEN), Blender(DEBIAN, folder)
    try:
        shared = other.start("pictures.other", str(folder), seconds=SECONDS)
        taken = window.run("pictures.story", str(raw), str(folder), seconds=SECONDS)
        shared.result()
        return taken
    finally:
        window.close()
        other.close()


def main(arguments: list[str]) -> int:
    if len(arguments) not in (1, 2):
        print(__doc__, file=sys.stderr)
        return 2
    output = Path(arguments[0])
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="skind-") as folder:
        raw = Path(arguments[1] if len(arguments) == 2 else folder).resolve()
        raw.mkdir(parents=True, exist_ok=True)
        for name, shot in take(Path(folder), raw).items():
            path = output / f"{name}.png"
            save(crop(shot), path)
            print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
