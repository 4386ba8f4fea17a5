//! The embedded typeface: Inter, cut to Latin, Greek and mathematical signs.

use std::sync::{Arc, LazyLock};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use resvg::usvg::fontdb::{Database, Weight};
use skrifa::instance::{LocationRef, Size};
use skrifa::{FontRef, MetadataProvider};

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

/// The typeface for rasterising, under the family and weights of [`face_css`].
pub(crate) fn database() -> Arc<Database> {
    static DATABASE: LazyLock<Arc<Database>> = LazyLock::new(|| {
        let mut all = Database::new();
        for face in [REGULAR, BOLD] {
            let mut own = Database::new();
            own.load_font_data(face.otf.to_vec());
            for mut info in own.faces().cloned() {
                info.weight = Weight(face.weight);
                info.families.truncate(1);
                for (family, _) in &mut info.families {
                    FAMILY.clone_into(family);
                }
                all.push_face_info(info);
            }
        }
        Arc::new(all)
    });
    Arc::clone(&DATABASE)
}

/// Width of a line of text in em: the sum of the advances of its glyphs, without kerning. A character without a glyph has
/// that of the glyph for missing characters.
pub(crate) fn width_em(text: &str, bold: bool) -> f64 {
    let face = if bold { BOLD } else { REGULAR };
    let font = FontRef::new(face.otf).expect("the embedded fonts are valid");
    let (glyphs, metrics) = (font.charmap(), font.glyph_metrics(Size::new(1.0), LocationRef::default()));
    let advance = |sign: char| metrics.advance_width(glyphs.map(sign).unwrap_or_default());
    text.chars().filter_map(advance).map(f64::from).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_fonts_have_every_sign_that_figures_use() {
        for face in [REGULAR, BOLD] {
            let font = FontRef::new(face.otf).expect("a font");
            for sign in "µ·−×°√–θσ∞≤≥é".chars() {
                assert!(font.charmap().map(sign).is_some(), "{sign}");
            }
        }
        assert!(width_em("mm", false) > width_em("ii", false));
        assert!(width_em("mm", true) > width_em("mm", false));
    }

    #[test]
    fn verif_both_weights_are_found_by_family_and_weight() {
        let database = database();
        let found = database.faces().map(|face| (face.families[0].0.as_str(), face.weight.0));
        assert_eq!(found.collect::<Vec<_>>(), [(FAMILY, 400), (FAMILY, 700)]);
    }
}
