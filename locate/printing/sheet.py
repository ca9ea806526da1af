"""A page of a stated size in millimetres, as PDF or PNG."""

import re
import struct
import zlib
from pathlib import Path

import cv2

from geometry.arrays import GreyImage
from geometry.atomic import atomic_path
from geometry.errors import BadInputError, UnwritableError

PAPERS_MM = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
}
MM_PER_INCH = 25.4
PT_PER_INCH = 72.0
PT_PER_MM = PT_PER_INCH / MM_PER_INCH
RULER_MM = 100.0
"""Length of the line that a user can measure."""
CAPTION_PT = 8
CAPTION_MM = 4.0
"""Height of the caption over the lower edge."""
IHDR_END = 33
"""Where the first chunk of a PNG ends: 8 bytes of signature, 25 of IHDR."""


def paper_mm(name: str) -> tuple[float, float]:
    """(width, height) of A4 to A0, or of 297x210mm.

    Raises:
        BadInputError: Neither.
    """
    if name.upper() in PAPERS_MM:
        return PAPERS_MM[name.upper()]
    sides = re.fullmatch(r"(\d+(?:\.\d+)?)x(\d+(?:\.\d+)?)(?:mm)?", name)
    if sides is None or min(map(float, sides.groups())) <= 0:
        raise BadInputError(
            f"paper {name!r} is unknown; take {', '.join(PAPERS_MM)} or a size such as 297x210mm"
        )
    return float(sides[1]), float(sides[2])


def png_bytes(image: GreyImage, dpi: float) -> bytes:
    """A PNG that knows its resolution (pHYs chunk)."""
    _, encoded = cv2.imencode(".png", image)
    png = encoded.tobytes()
    per_metre = round(dpi / MM_PER_INCH * 1000)
    chunk = b"pHYs" + struct.pack(">IIB", per_metre, per_metre, 1)
    framed = struct.pack(">I", 9) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return png[:IHDR_END] + framed + png[IHDR_END:]


def pdf_bytes(
    image: GreyImage, dpi: float, page_mm: tuple[float, float], caption: str | None
) -> bytes:
    """A PDF 1.4 of one page: the image from its top left corner at `dpi`, a ruler, a caption.

    Source: ISO 32000-1, sections 7.5 (file structure) and 8.9.5 (images).

    Args:
        image: (H, W), as large as the page or up to one dot larger.
        dpi: Dots per inch.
        page_mm: Width and height of the page.
        caption: Written over the lower edge beside a line of 100 mm; ASCII; None leaves both out.
    """
    rows, columns = image.shape
    width, height = (side * PT_PER_MM for side in page_mm)
    dot = PT_PER_INCH / dpi
    content = f"q {columns * dot:.6f} 0 0 {rows * dot:.6f} 0 {height - rows * dot:.6f} cm /I Do Q"
    content += "" if caption is None else _ruler_content(caption)
    page = (
        f"<</Type/Page/Parent 2 0 R/MediaBox[0 0 {width:.6f} {height:.6f}]/Contents 4 0 R"
        "/Resources<</XObject<</I 5 0 R>>/Font<</F 6 0 R>>>>>>"
    )
    picture = (
        f"/Type/XObject/Subtype/Image/Width {columns}/Height {rows}"
        "/ColorSpace/DeviceGray/BitsPerComponent 8/Interpolate false/Filter/FlateDecode"
    )
    return _assemble_pdf(
        [
            b"<</Type/Catalog/Pages 2 0 R>>",
            b"<</Type/Pages/Kids[3 0 R]/Count 1>>",
            page.encode(),
            _pdf_stream("", content.encode()),
            _pdf_stream(picture, zlib.compress(image.tobytes())),
            b"<</Type/Font/Subtype/Type1/BaseFont/Helvetica>>",
        ]
    )


def _ruler_content(caption: str) -> str:
    left, base = 2 * CAPTION_MM * PT_PER_MM, CAPTION_MM * PT_PER_MM
    right = left + RULER_MM * PT_PER_MM
    text = caption.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    ends = " ".join(f"{x:.4f} {base - 3:.4f} m {x:.4f} {base + 3:.4f} l" for x in (left, right))
    return (
        f"\n0.5 w {left:.4f} {base:.4f} m {right:.4f} {base:.4f} l {ends} S"
        f"\nBT /F {CAPTION_PT} Tf {right + 6:.4f} {base - 3:.4f} Td ({text}) Tj ET"
    )


def _pdf_stream(entries: str, data: bytes) -> bytes:
    return f"<<{entries}/Length {len(data)}>>\nstream\n".encode() + data + b"\nendstream"


def _assemble_pdf(objects: list[bytes]) -> bytes:
    file, offsets = b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n", []
    for number, body in enumerate(objects, start=1):
        offsets.append(len(file))
        file += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    table = "".join(f"{offset:010d} 00000 n \n" for offset in offsets)
    return (
        file
        + (
            f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}"
            f"trailer\n<</Size {len(objects) + 1}/Root 1 0 R>>\nstartxref\n{len(file)}\n%%EOF\n"
        ).encode()
    )


def write_sheet(
    path: Path, image: GreyImage, dpi: float, page_mm: tuple[float, float], caption: str | None
) -> None:
    """Writes the page in the format that the name ends in, all or nothing.

    Raises:
        BadInputError: Another format than .pdf or .png, or a file that cannot be written.
    """
    match path.suffix.lower():
        case ".pdf":
            content = pdf_bytes(image, dpi, page_mm, caption)
        case ".png":
            content = png_bytes(image, dpi)
        case other:
            raise BadInputError(f"{path}: {other or 'no'} format; end the name in .pdf or .png")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as unfinished:
            unfinished.write_bytes(content)
    except OSError as error:
        raise UnwritableError.of(path, error) from error
