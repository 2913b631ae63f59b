"""Screenshots of several states side by side, each with its number, as one small PNG."""

import io
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

GAP_PX = 8
LABEL_PX = 30
COLOURS = 256
"""Size of the palette: the pages have few colours, and the files are part of every clone."""


def contact_sheet(file: Path, shots: list[bytes], columns: int, width: int) -> None:
    """Write screenshots of one size, row by row; one that is alone has no number.

    Args:
        file: the picture that is written.
        shots: PNG files.
        columns: screenshots in a row.
        width: of each of them in the sheet, in pixels.
    """
    tiles = [Image.open(io.BytesIO(shot)).convert("RGB") for shot in shots]
    height = round(tiles[0].height * width / tiles[0].width)
    label_px = LABEL_PX if len(tiles) > 1 else 0
    step_x, step_y = width + GAP_PX, height + GAP_PX + label_px
    rows = -(-len(tiles) // columns)
    sheet = Image.new("RGB", (columns * step_x - GAP_PX, rows * step_y - GAP_PX), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(LABEL_PX - 8)
    for index, tile in enumerate(tiles):
        x, y = index % columns * step_x, index // columns * step_y
        if label_px:
            draw.text((x + 2, y), f"{index + 1}", fill="#14212b", font=font)
        small = tile.resize((width, height), Image.Resampling.LANCZOS)
        sheet.paste(small, (x, y + label_px))
    file.parent.mkdir(parents=True, exist_ok=True)
    # Colours of small areas, as of a legend, stay what they are.
    flat = sheet.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    flat.save(file, optimize=True)
