//! Drawing in CSS pixels, clipped to rectangles; and the two files of a picture.

use std::fs;
use std::path::Path;
use std::sync::Once;

use anyhow::{Context, Result, anyhow};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use files::write_atomically;
use plotters::coord::Shift;
use plotters::element::BitMapElement;
use plotters::prelude::*;
use plotters::style::register_font;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::surface::{FONT_HEIGHT_EM, Surface, UNITS_PER_PX, svg_baselines};

/// The embedded typeface: Inter, cut to Latin, Greek and mathematical signs.
pub(crate) const FONT_FAMILY: &str = "Inter";

/// Image pixels in a CSS pixel of the PNG files.
const PNG_SCALE: u32 = 2;

/// Length of a dash.
const DASH_PX: f64 = 5.0;
/// Space between dashes.
const DASH_GAP_PX: f64 = 4.0;

/// A point in CSS pixels, y downwards.
pub(crate) type Px = (f64, f64);

/// Paints a picture.
pub(crate) type Paint = dyn Fn(&Canvas) -> Result<()>;

/// A picture that has been laid out and can be painted on any backend.
pub(crate) struct Picture {
    /// Width in CSS pixels.
    pub(crate) width_px: u32,
    /// Height in CSS pixels.
    pub(crate) height_px: u32,
    /// Paints it.
    pub(crate) paint: Box<Paint>,
}

/// Where a text stands on its anchor.
#[derive(Clone, Copy)]
pub(crate) enum Align {
    /// Starts at the anchor.
    Left,
    /// Is centred on the anchor.
    Center,
    /// Ends at the anchor.
    Right,
    /// Is centred on the anchor and runs upwards.
    Upwards,
}

/// Size, weight, colour and alignment of a text.
#[derive(Clone, Copy)]
pub(crate) struct Lettering {
    /// Font size in CSS pixels.
    pub(crate) size_px: f64,
    /// Semi-bold instead of regular.
    pub(crate) bold: bool,
    /// Colour.
    pub(crate) color: RGBColor,
    /// Alignment to the anchor; vertically a text is always centred on it.
    pub(crate) align: Align,
}

/// A surface of a figure, addressed in CSS pixels.
pub(crate) struct Canvas<'a>(DrawingArea<Surface<'a>, Shift>);

impl Canvas<'_> {
    /// Width in CSS pixels.
    pub(crate) fn width_px(&self) -> f64 {
        f64::from(self.0.dim_in_pixel().0 / UNITS_PER_PX)
    }

    /// Height in CSS pixels.
    pub(crate) fn height_px(&self) -> f64 {
        f64::from(self.0.dim_in_pixel().1 / UNITS_PER_PX)
    }

    /// An open line through the points.
    pub(crate) fn line(&self, points: &[Px], color: RGBAColor, width_px: f64) -> Result<()> {
        let mut path: Vec<_> = points.iter().map(|&point| units(point)).collect();
        path.dedup();
        let stroke = color.stroke_width((width_px * f64::from(UNITS_PER_PX)).round() as u32);
        self.draw(&PathElement::new(path, stroke))
    }

    /// A straight dashed line.
    pub(crate) fn dashes(&self, from: Px, to: Px, color: RGBAColor) -> Result<()> {
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        let along = |distance: f64| {
            let share = distance.min(length) / length;
            (from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1))
        };
        let mut start = 0.0;
        while start < length {
            self.line(&[along(start), along(start + DASH_PX)], color, 1.25)?;
            start += DASH_PX + DASH_GAP_PX;
        }
        Ok(())
    }

    /// A filled polygon.
    pub(crate) fn polygon(&self, corners: &[Px], color: RGBAColor) -> Result<()> {
        let corners: Vec<_> = corners.iter().map(|&corner| units(corner)).collect();
        self.draw(&Polygon::new(corners, color))
    }

    /// A filled disc.
    pub(crate) fn disc(&self, center: Px, radius_px: f64, color: RGBAColor) -> Result<()> {
        let radius = (radius_px * f64::from(UNITS_PER_PX)).round() as i32;
        self.draw(&Circle::new(units(center), radius, color.filled()))
    }

    /// A line of text; nothing where it is empty.
    pub(crate) fn text(&self, text: &str, anchor: Px, lettering: Lettering) -> Result<()> {
        if text.is_empty() {
            return Ok(());
        }
        let h_pos = match lettering.align {
            Align::Left => HPos::Left,
            Align::Center | Align::Upwards => HPos::Center,
            Align::Right => HPos::Right,
        };
        let transform = match lettering.align {
            Align::Upwards => FontTransform::Rotate270,
            _ => FontTransform::None,
        };
        let style = text_style(lettering).transform(transform).pos(Pos::new(h_pos, VPos::Center));
        self.0.draw_text(text, &style, units(anchor)).map_err(|error| anyhow!("{error}"))
    }

    /// Width of a line of text in CSS pixels.
    pub(crate) fn text_width_px(&self, text: &str, lettering: Lettering) -> Result<f64> {
        let (width, _) = self.0.estimate_text_size(text, &text_style(lettering)).map_err(|error| anyhow!("{error}"))?;
        Ok(f64::from(width) / f64::from(UNITS_PER_PX))
    }

    fn draw<'e, E>(&self, element: &'e E) -> Result<()>
    where
        &'e E: plotters::element::PointCollection<'e, (i32, i32)>,
        E: for<'s> plotters::element::Drawable<Surface<'s>>,
    {
        self.0.draw(element).map_err(|error| anyhow!("{error}"))
    }
}

fn units((x, y): Px) -> (i32, i32) {
    let scale = f64::from(UNITS_PER_PX);
    ((x * scale).round() as i32, (y * scale).round() as i32)
}

fn text_style(lettering: Lettering) -> TextStyle<'static> {
    let style = if lettering.bold { FontStyle::Bold } else { FontStyle::Normal };
    let size = lettering.size_px * f64::from(UNITS_PER_PX) * FONT_HEIGHT_EM;
    FontDesc::new(FontFamily::Name(FONT_FAMILY), size, style).color(&lettering.color)
}

/// `@font-face` rules with the typeface inside.
pub(crate) fn font_face_css() -> String {
    let fonts: [(u32, &[u8]); 2] = [
        (400, include_bytes!("../assets/inter-regular.woff2")),
        (700, include_bytes!("../assets/inter-semibold.woff2")),
    ];
    fonts
        .iter()
        .map(|(weight, bytes)| {
            format!(
                "@font-face{{font-family:{FONT_FAMILY};font-weight:{weight};\
                 src:url(data:font/woff2;base64,{}) format(\"woff2\")}}",
                BASE64.encode(bytes)
            )
        })
        .collect()
}

fn register_fonts() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let fonts: [(FontStyle, &'static [u8]); 2] = [
            (FontStyle::Normal, include_bytes!("../assets/inter-regular.otf")),
            (FontStyle::Bold, include_bytes!("../assets/inter-semibold.otf")),
        ];
        for (style, bytes) in fonts {
            let registered = register_font(FONT_FAMILY, style, bytes);
            assert!(registered.is_ok(), "the embedded fonts are valid");
        }
    });
}

impl Picture {
    /// The picture as an SVG element without a font of its own, to stand in a page that has [`font_face_css`]; `title`
    /// is what a screen reader says.
    pub(crate) fn to_inline_svg(&self, title: &str) -> Result<String> {
        self.to_svg(title, "")
    }

    /// The picture as an SVG file that looks alike everywhere.
    pub(crate) fn to_standalone_svg(&self, title: &str) -> Result<String> {
        self.to_svg(title, &format!("<style>{}</style>", font_face_css()))
    }

    fn to_svg(&self, title: &str, style: &str) -> Result<String> {
        let mut drawn = String::new();
        let size = self.size_units();
        self.paint_on(Surface::Svg(SVGBackend::with_string(&mut drawn, size)))?;
        let (_, body) = drawn.split_once('\n').context("plotters wrote an SVG without a first line")?;
        Ok(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" viewBox=\"0 0 {} {}\" role=\"img\" \
             aria-label=\"{title}\" stroke-linejoin=\"round\" stroke-linecap=\"round\">\n{style}{}",
            self.width_px,
            self.height_px,
            size.0,
            size.1,
            svg_baselines(body)
        ))
    }

    /// Writes the picture as a PNG of two image pixels a CSS pixel: painted in drawing units, then averaged.
    ///
    /// # Errors
    /// When the file cannot be written; the error names it, and nothing half-written stays.
    pub(crate) fn write_png(&self, path: &Path) -> Result<()> {
        let (width, height) = self.size_units();
        let mut fine = vec![0; (width * height * 3) as usize];
        self.paint_on(Surface::Raster(BitMapBackend::with_buffer(&mut fine, (width, height))))?;
        let factor = UNITS_PER_PX / PNG_SCALE;
        let size = (width / factor, height / factor);
        let pixels = average_blocks(&fine, width as usize, factor as usize);
        let element = BitMapElement::with_owned_buffer((0, 0), size, pixels)
            .context("the picture's size does not fit its pixels")?;
        let encoded = encode_png(&element, size).with_context(|| format!("{}: cannot be encoded", path.display()))?;
        Ok(write_atomically(path, &encoded)?)
    }

    fn size_units(&self) -> (u32, u32) {
        (self.width_px * UNITS_PER_PX, self.height_px * UNITS_PER_PX)
    }

    fn paint_on(&self, surface: Surface) -> Result<()> {
        register_fonts();
        let canvas = Canvas(surface.into_drawing_area());
        canvas.0.fill(&WHITE).map_err(|error| anyhow!("{error}"))?;
        (self.paint)(&canvas)?;
        canvas.0.present().map_err(|error| anyhow!("{error}"))
    }
}

/// The bytes of a PNG file. The library encodes into a named file only: one that goes with its handle, whatever happens.
fn encode_png(element: &BitMapElement<(i32, i32)>, size: (u32, u32)) -> Result<Vec<u8>> {
    let scratch = tempfile::Builder::new().suffix(".png").tempfile()?;
    let image = BitMapBackend::new(scratch.path(), size).into_drawing_area();
    image.draw(element)?;
    image.present()?;
    Ok(fs::read(scratch.path())?)
}

/// Averages RGB blocks of `factor` x `factor` in an image of `width`.
fn average_blocks(fine: &[u8], width: usize, factor: usize) -> Vec<u8> {
    let (columns, rows) = (width / factor, fine.len() / (3 * width * factor));
    let mut coarse = Vec::with_capacity(columns * rows * 3);
    let count = (factor * factor) as u32;
    for row in 0..rows {
        for column in 0..columns {
            for channel in 0..3 {
                let mut sum = 0;
                for y in 0..factor {
                    let start = ((row * factor + y) * width + column * factor) * 3 + channel;
                    sum += (0..factor).map(|x| u32::from(fine[start + 3 * x])).sum::<u32>();
                }
                coarse.push(((sum + count / 2) / count) as u8);
            }
        }
    }
    coarse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_averaging_keeps_the_mean_of_each_block() {
        let pixel = |value: u8| [value, value + 1, value + 2];
        let fine: Vec<u8> = [0, 10, 100, 110, 20, 30, 120, 130].into_iter().flat_map(pixel).collect();
        assert_eq!(average_blocks(&fine, 4, 2), [15, 16, 17, 115, 116, 117]);
    }

    #[test]
    fn verif_fonts_draw_every_sign_that_figures_use() {
        let picture = Picture {
            width_px: 40,
            height_px: 20,
            paint: Box::new(|canvas| {
                let lettering = Lettering { size_px: 12.0, bold: false, color: BLACK, align: Align::Left };
                let blank = canvas.text_width_px("\u{fffd}", lettering)?;
                for sign in ['µ', '·', '−', '×', '°', '√', '–', 'θ', 'σ'] {
                    let width = canvas.text_width_px(&sign.to_string(), lettering)?;
                    assert!(width > 0.0 && width != blank, "{sign}: {width}");
                }
                Ok(())
            }),
        };
        picture.to_inline_svg("signs").expect("drawn");
    }
}
