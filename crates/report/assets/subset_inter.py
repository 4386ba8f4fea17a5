"""Cut the report's two fonts out of Inter (https://rsms.me/inter, release 4, Open Font License).

    python subset_inter.py FOLDER_WITH_INTER_OTF_FILES

needs `fonttools` and `brotli`, and writes `inter-<weight>.otf` for the PNG figures and `inter-<weight>.woff2`, the same
glyphs, for the page and the SVG figures.
"""

import sys
from pathlib import Path

from fontTools.subset import Options, Subsetter
from fontTools.ttLib import TTFont

SOURCES = {"regular": "Inter-Regular.otf", "semibold": "Inter-SemiBold.otf"}
CHARACTERS = (
    "".join(map(chr, range(0x20, 0x7F)))
    + "".join(map(chr, range(0xA1, 0x100)))
    + "ΓΔΘΛΞΠΣΦΨΩαβγδεζηθικλμνξπρστυφχψω"
    + "\u00a0\u2009\u202f–—‘’“”…•′″×·−±≤≥≈≠√∞∂∫∑→←↑↓⁰⁴⁵⁶⁷⁸⁹⁻₀₁₂₃"
)
# Vertical metrics of the cut fonts: a line is 1.24 em high.
ASCENDER_EM, DESCENDER_EM = 0.97, -0.27


def cut(source: Path, target: Path, flavor: str | None) -> None:
    """Write the subset of the font `source` to `target`, as WOFF2 or, without a flavor, as OpenType."""
    font = TTFont(source, recalcTimestamp=False)
    options = Options(layout_features=["kern"], desubroutinize=True, hinting=False)
    subsetter = Subsetter(options)
    subsetter.populate(text=CHARACTERS)
    subsetter.subset(font)
    em = font["head"].unitsPerEm
    ascender, descender = round(ASCENDER_EM * em), round(DESCENDER_EM * em)
    font["hhea"].ascender, font["hhea"].descender, font["hhea"].lineGap = ascender, descender, 0
    os2 = font["OS/2"]
    os2.sTypoAscender, os2.sTypoDescender, os2.sTypoLineGap = ascender, descender, 0
    font.flavor = flavor
    font.save(target)


def main() -> None:
    """Cut every weight, in both formats, into the working directory."""
    folder = Path(sys.argv[1])
    for weight, name in SOURCES.items():
        cut(folder / name, Path(f"inter-{weight}.otf"), None)
        cut(folder / name, Path(f"inter-{weight}.woff2"), "woff2")


if __name__ == "__main__":
    main()
