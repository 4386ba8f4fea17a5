//! The embedded typeface: Inter, cut to Latin, Greek and mathematical signs.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use ttf_parser::{GlyphId, OutlineBuilder};

/// Family name of the typeface.
pub(crate) const FAMILY: &str = "Inter";

/// Distance of the baseline below the middle of capitals and digits, in em.
pub(crate) const MIDDLE_EM: f64 = 0.36;

/// One weight of the typeface.
struct Face {
    /// Weight in CSS.
    weight: u16,
    /// OpenType, for measuring and for PNG files.
    otf: &'static [u8],
    /// The same glyphs as WOFF2, for the page and SVG files.
    woff2: &'static [u8],
}

const REGULAR: Face = Face {
    weight: 400,
    otf: include_bytes!("../assets/inter-regular.otf"),
    woff2: include_bytes!("../assets/inter-regular.woff2"),
};

const BOLD: Face = Face {
    weight: 700,
    otf: include_bytes!("../assets/inter-semibold.otf"),
    woff2: include_bytes!("../assets/inter-semibold.woff2"),
};

/// `@font-face` rules with the typeface inside.
pub(crate) fn face_css() -> String {
    [REGULAR, BOLD]
        .iter()
        .map(|face| {
            format!(
                "@font-face{{font-family:{FAMILY};font-weight:{};src:url(data:font/woff2;base64,{}) format(\"woff2\")}}",
                face.weight,
                BASE64.encode(face.woff2)
            )
        })
        .collect()
}

/// A line of text as outlines of its glyphs, in font units with y upwards: side by side at their advances, without kerning.
pub(crate) struct Outlines {
    /// Path data as in the attribute `d` of an SVG path.
    pub(crate) path: String,
    /// Sum of the advances, in em.
    pub(crate) width_em: f64,
    /// Font units in an em.
    pub(crate) units_per_em: f64,
}

/// Outlines of a line of text. A character without a glyph has that of the glyph for missing characters.
pub(crate) fn outlines(text: &str, bold: bool) -> Outlines {
    let font = parsed(bold);
    let mut pen = Pen::default();
    for glyph in glyphs(&font, text) {
        // A glyph without outline is a space.
        let _ = font.outline_glyph(glyph, &mut pen);
        pen.x += f32::from(font.glyph_hor_advance(glyph).unwrap_or_default());
    }
    let units_per_em = f64::from(font.units_per_em());
    Outlines { path: pen.path, width_em: f64::from(pen.x) / units_per_em, units_per_em }
}

/// Width of a line of text in em: the sum of the advances of its glyphs, without kerning. A character without a glyph has
/// that of the glyph for missing characters.
pub(crate) fn width_em(text: &str, bold: bool) -> f64 {
    let font = parsed(bold);
    let advances = glyphs(&font, text).filter_map(|glyph| font.glyph_hor_advance(glyph));
    advances.map(f64::from).sum::<f64>() / f64::from(font.units_per_em())
}

fn parsed(bold: bool) -> ttf_parser::Face<'static> {
    let face = if bold { BOLD } else { REGULAR };
    ttf_parser::Face::parse(face.otf, 0).expect("the embedded fonts are valid")
}

fn glyphs(font: &ttf_parser::Face, text: &str) -> impl Iterator<Item = GlyphId> {
    text.chars().map(|sign| font.glyph_index(sign).unwrap_or(GlyphId(0)))
}

/// Writes outlines as path data.
#[derive(Default)]
struct Pen {
    /// Place of the current glyph's origin, in font units.
    x: f32,
    path: String,
}

impl Pen {
    fn draw(&mut self, command: char, points: &[(f32, f32)]) {
        self.path.push(command);
        for (x, y) in points {
            write!(self.path, "{} {} ", x + self.x, y).expect("writing to a string succeeds");
        }
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        self.draw('M', &[(x, y)]);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.draw('L', &[(x, y)]);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.draw('Q', &[(x1, y1), (x, y)]);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.draw('C', &[(x1, y1), (x2, y2), (x, y)]);
    }

    fn close(&mut self) {
        self.path.push('Z');
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_fonts_have_every_sign_that_figures_use() {
        for bold in [false, true] {
            let font = parsed(bold);
            for sign in "µ·−×°√–θσ∞≤≥é".chars() {
                assert!(font.glyph_index(sign).is_some(), "{sign}");
            }
            assert!(width_em("mm", bold) > width_em("ii", bold));
        }
        assert!(width_em("mm", true) > width_em("mm", false));
    }

    #[test]
    fn verif_outlines_are_as_wide_as_the_text_and_lie_side_by_side() {
        let (one, two) = (outlines("l", false), outlines("l l", false));
        assert_eq!(two.width_em, width_em("l l", false));
        assert!(two.path.starts_with(&one.path) && two.path.len() > one.path.len());
        assert_eq!(two.path.matches('M').count(), 2, "a space has no outline: {}", two.path);
    }
}
