//! Drawing in CSS pixels: SVG elements, and the SVG and PNG files of a picture.

use std::cell::RefCell;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use files::write_atomically;
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};

use super::color::{Rgb, Rgba};
use super::font::{self, outlines};

/// Image pixels in a CSS pixel of the PNG files.
const PNG_SCALE: f32 = 2.0;

/// Length of a dash.
const DASH_PX: f64 = 5.0;
/// Space between dashes.
const DASH_GAP_PX: f64 = 4.0;
/// Largest width at which a page shows a picture, over the width at which it was laid out.
const LARGEST_ZOOM: f64 = 1.25;

/// A point in CSS pixels, y downwards.
pub(crate) type Px = (f64, f64);

/// Paints a picture.
pub(crate) type Paint = dyn Fn(&Canvas) -> Result<()>;

/// A picture that has been laid out.
pub(crate) struct Picture {
    /// Width and height in CSS pixels.
    size_px: (u32, u32),
    /// Caption of this picture beyond that of its figure: methods, sets and trials drawn. May be empty.
    pub(crate) note: String,
    /// Pictures of the same kind that together show every method; empty if this one does.
    pub(crate) all_methods: Vec<Picture>,
    paint: Box<Paint>,
}

/// Position of a text relative to its anchor. Vertically it is always centred.
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

impl Align {
    /// Share of a text's width that lies before its anchor.
    fn before(self) -> f64 {
        match self {
            Self::Left => 0.0,
            Self::Center | Self::Upwards => 0.5,
            Self::Right => 1.0,
        }
    }
}

/// Size, weight, colour and alignment of a text.
#[derive(Clone, Copy)]
pub(crate) struct Lettering {
    /// Font size in CSS pixels.
    pub(crate) size_px: f64,
    /// Semi-bold instead of regular.
    pub(crate) bold: bool,
    /// Colour.
    pub(crate) color: Rgb,
    /// Alignment to the anchor.
    pub(crate) align: Align,
}

/// Form of texts in an SVG.
#[derive(Clone, Copy, PartialEq)]
enum Texts {
    /// Text elements: they can be searched and copied, and need the font.
    Elements,
    /// Outlines of the glyphs, for rasterising.
    Outlines,
}

/// The elements of a picture, addressed in CSS pixels.
pub(crate) struct Canvas {
    size_px: (u32, u32),
    texts: Texts,
    elements: RefCell<String>,
}

impl Canvas {
    /// Width in CSS pixels.
    pub(crate) fn width_px(&self) -> f64 {
        f64::from(self.size_px.0)
    }

    /// Height in CSS pixels.
    pub(crate) fn height_px(&self) -> f64 {
        f64::from(self.size_px.1)
    }

    /// An open line through the points, with round joins and ends.
    pub(crate) fn line(&self, points: &[Px], color: impl Into<Rgba>, width_px: f64) -> Result<()> {
        let attributes =
            format!("fill=\"none\" stroke-width=\"{}\" {}", round(width_px), paint("stroke", color.into()));
        self.element(format_args!("<polyline {attributes} points=\"{}\"/>", coordinates(points)))
    }

    /// A straight dashed line.
    pub(crate) fn dashes(&self, from: Px, to: Px, color: impl Into<Rgba>) -> Result<()> {
        self.element(format_args!(
            "<polyline fill=\"none\" stroke-width=\"1.25\" stroke-linecap=\"butt\" stroke-dasharray=\"{DASH_PX} {DASH_GAP_PX}\" \
             {} points=\"{}\"/>",
            paint("stroke", color.into()),
            coordinates(&[from, to])
        ))
    }

    /// A filled polygon.
    pub(crate) fn polygon(&self, corners: &[Px], color: impl Into<Rgba>) -> Result<()> {
        self.element(format_args!("<polygon {} points=\"{}\"/>", paint("fill", color.into()), coordinates(corners)))
    }

    /// A filled disc.
    pub(crate) fn disc(&self, (x, y): Px, radius_px: f64, color: impl Into<Rgba>) -> Result<()> {
        let (x, y, radius) = (round(x), round(y), round(radius_px));
        self.element(format_args!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" {}/>", paint("fill", color.into())))
    }

    /// A line of text. An empty one draws nothing.
    pub(crate) fn text(&self, text: &str, (x, y): Px, lettering: Lettering) -> Result<()> {
        if text.is_empty() {
            return Ok(());
        }
        let (x, y) = (round(x), round(y));
        let baseline = round(y + font::MIDDLE_EM * lettering.size_px);
        let turn = match lettering.align {
            Align::Upwards => format!(" transform=\"rotate(-90 {x} {y})\""),
            _ => String::new(),
        };
        let fill = paint("fill", lettering.color.into());
        if self.texts == Texts::Outlines {
            let outlines = outlines(text, lettering.bold);
            let left = x - lettering.align.before() * lettering.size_px * outlines.width_em;
            let scale = lettering.size_px / outlines.units_per_em;
            return self.element(format_args!(
                "<g{turn}><path transform=\"matrix({scale} 0 0 {} {left} {baseline})\" {fill} d=\"{}\"/></g>",
                -scale, outlines.path
            ));
        }
        let anchor = match lettering.align {
            Align::Left => "start",
            Align::Center | Align::Upwards => "middle",
            Align::Right => "end",
        };
        let weight = if lettering.bold { " font-weight=\"bold\"" } else { "" };
        self.element(format_args!(
            "<text x=\"{x}\" y=\"{baseline}\" font-size=\"{}\"{weight} text-anchor=\"{anchor}\" {fill}{turn}>{}</text>",
            lettering.size_px,
            maud::html! { (text) }.into_string()
        ))
    }

    /// Width of a line of text in CSS pixels.
    pub(crate) fn text_width_px(&self, text: &str, lettering: Lettering) -> f64 {
        lettering.size_px * font::width_em(text, lettering.bold)
    }

    fn element(&self, element: std::fmt::Arguments) -> Result<()> {
        writeln!(self.elements.borrow_mut(), "{element}").context("SVG")
    }
}

/// The attributes that paint a fill or stroke.
fn paint(what: &str, Rgba(Rgb(red, green, blue), opacity): Rgba) -> String {
    let color = format!("{what}=\"#{red:02x}{green:02x}{blue:02x}\"");
    if opacity < 1.0 { format!("{color} {what}-opacity=\"{}\"", round(opacity)) } else { color }
}

/// A length to a hundredth.
fn round(value: f64) -> f64 {
    (100.0 * value).round() / 100.0
}

/// Points to a tenth of a pixel, without repetitions.
fn coordinates(points: &[Px]) -> String {
    let mut tenths: Vec<[i64; 2]> =
        points.iter().map(|&(x, y)| [x, y].map(|value| (10.0 * value).round() as i64)).collect();
    tenths.dedup();
    // A line of one point is a dot with its round ends.
    if let [point] = tenths[..] {
        tenths.push(point);
    }
    let pairs: Vec<String> = tenths.iter().map(|[x, y]| format!("{},{}", *x as f64 / 10.0, *y as f64 / 10.0)).collect();
    pairs.join(" ")
}

impl Picture {
    /// A picture of a width and height in CSS pixels.
    pub(crate) fn new(width_px: u32, height_px: u32, paint: impl Fn(&Canvas) -> Result<()> + 'static) -> Self {
        Self { size_px: (width_px, height_px), note: String::new(), all_methods: Vec::new(), paint: Box::new(paint) }
    }

    /// The same picture with a caption of its own.
    pub(crate) fn noted(self, note: String) -> Self {
        Self { note, ..self }
    }

    /// The picture as an SVG element without a font, for a page that has [`font::face_css`]; `title` is its label for screen
    /// readers.
    pub(crate) fn to_inline_svg(&self, title: &str) -> Result<String> {
        self.to_svg(title, "", Texts::Elements)
    }

    /// The picture as an SVG file with its font.
    pub(crate) fn to_standalone_svg(&self, title: &str) -> Result<String> {
        self.to_svg(title, &format!("<style>{}</style>\n", font::face_css()), Texts::Elements)
    }

    fn to_svg(&self, title: &str, style: &str, texts: Texts) -> Result<String> {
        let canvas = Canvas { size_px: self.size_px, texts, elements: RefCell::default() };
        (self.paint)(&canvas)?;
        let (width, height) = self.size_px;
        let widest = LARGEST_ZOOM * f64::from(width);
        Ok(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
             role=\"img\" aria-label=\"{title}\" style=\"max-width:{widest}px\" font-family=\"{}\" stroke-linejoin=\"round\" \
             stroke-linecap=\"round\">\n{style}<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n{}</svg>\n",
            font::FAMILY,
            canvas.elements.into_inner()
        ))
    }

    /// Writes the picture as a PNG of [`PNG_SCALE`] image pixels per CSS pixel, rasterised from its SVG.
    ///
    /// # Errors
    /// When the file cannot be written; the error names it, and no part of it is left.
    pub(crate) fn write_png(&self, path: &Path) -> Result<()> {
        let tree = Tree::from_str(&self.to_svg("", "", Texts::Outlines)?, &Options::default()).context("SVG")?;
        let size = tree.size().to_int_size().scale_by(PNG_SCALE).context("a picture without size")?;
        let mut pixels = Pixmap::new(size.width(), size.height()).context("a picture without size")?;
        resvg::render(&tree, Transform::from_scale(PNG_SCALE, PNG_SCALE), &mut pixels.as_mut());
        let encoded = pixels.encode_png().with_context(|| format!("{}: cannot be encoded", path.display()))?;
        Ok(write_atomically(path, &encoded)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(paint: impl Fn(&Canvas) -> Result<()> + 'static) -> String {
        Picture::new(40, 20, paint).to_inline_svg("test").expect("drawn")
    }

    #[test]
    fn verif_points_are_rounded_and_repetitions_left_out() {
        assert_eq!(coordinates(&[(0.04, 1.0), (0.0, 1.01), (12.34, -5.0)]), "0,1 12.3,-5");
        assert_eq!(coordinates(&[(1.0, 2.0), (1.0, 2.0)]), "1,2 1,2", "a dot");
    }

    #[test]
    fn verif_text_is_escaped_and_opacity_is_written_where_it_counts() {
        let lettering = Lettering { size_px: 10.0, bold: true, color: Rgb(1, 2, 255), align: Align::Upwards };
        let svg = picture(move |canvas| {
            canvas.text("a < b", (5.0, 6.0), lettering)?;
            canvas.disc((1.0, 2.0), 3.0, Rgb::WHITE.mix(0.5))
        });
        assert!(svg.contains("transform=\"rotate(-90 5 6)\">a &lt; b</text>"), "{svg}");
        assert!(
            svg.contains("y=\"9.6\" font-size=\"10\" font-weight=\"bold\" text-anchor=\"middle\" fill=\"#0102ff\""),
            "{svg}"
        );
        assert!(svg.contains("r=\"3\" fill=\"#ffffff\" fill-opacity=\"0.5\""), "{svg}");
    }

    #[test]
    fn verif_a_png_has_the_colours_of_the_picture_at_twice_its_size() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("picture.png");
        let lettering = Lettering { size_px: 12.0, bold: true, color: Rgb(200, 0, 0), align: Align::Left };
        let picture = Picture::new(40, 20, move |canvas| {
            canvas.polygon(&[(0.0, 0.0), (10.0, 0.0), (10.0, 20.0), (0.0, 20.0)], Rgb(0, 114, 178))?;
            canvas.text("MMM", (12.0, 10.0), lettering)
        });
        picture.write_png(&path).expect("written");
        let pixels = Pixmap::load_png(&path).expect("a PNG");
        assert_eq!((pixels.width(), pixels.height()), (80, 40));
        let at = |x, y| pixels.pixel(x, y).map(|pixel| (pixel.red(), pixel.green(), pixel.blue()));
        assert_eq!([at(5, 20), at(79, 0)], [Some((0, 114, 178)), Some((255, 255, 255))]);
        let red = pixels.pixels().iter().filter(|pixel| pixel.red() == 200 && pixel.green() == 0).count();
        assert!(red > 100, "pixels of the text: {red}");
    }
}
