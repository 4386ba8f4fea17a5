//! Colours, markers, lettering and legends common to all figures.

use anyhow::Result;

use super::canvas::{Align, Canvas, Lettering, Px};
use super::color::{Rgb, Rgba};

// The colour-blind safe palette of Okabe and Ito (jfly.uni-koeln.de/color), with a dark grey for its black and without
// its yellow, which has too little contrast on white.
pub(crate) const BLUE: Rgb = Rgb(0, 114, 178);
pub(crate) const ORANGE: Rgb = Rgb(230, 159, 0);
pub(crate) const GREEN: Rgb = Rgb(0, 158, 115);
pub(crate) const PURPLE: Rgb = Rgb(204, 121, 167);
pub(crate) const VERMILION: Rgb = Rgb(213, 94, 0);
pub(crate) const SKY: Rgb = Rgb(86, 180, 233);
pub(crate) const DARK: Rgb = Rgb(60, 60, 60);

/// Colours of methods, in order.
const PALETTE: [Rgb; 7] = [BLUE, ORANGE, GREEN, PURPLE, VERMILION, SKY, DARK];

/// Most methods in a picture: one for each colour but the last, which is close to that of the truth and of bounds.
pub(crate) const LOOKS: usize = PALETTE.len() - 1;

/// Text and the truth.
pub(crate) const INK: Rgb = Rgb(31, 35, 40);
/// Axis labels and secondary text.
pub(crate) const MUTED: Rgb = Rgb(87, 96, 106);
/// Frames of panels.
pub(crate) const FRAME: Rgb = Rgb(140, 149, 159);
/// Grid lines.
pub(crate) const GRID: Rgb = Rgb(226, 229, 233);
/// Grid lines between those with a number.
pub(crate) const FINE_GRID: Rgb = Rgb(241, 243, 245);
/// The inside of an object.
pub(crate) const OBJECT: Rgb = Rgb(233, 236, 239);
/// Readings behind the values of filters.
pub(crate) const READING: Rgb = Rgb(86, 96, 110);
/// Stated uncertainties and intervals.
pub(crate) const STATED: Rgb = Rgb(125, 133, 144);
/// Durations of true contacts.
pub(crate) const TRUE_CONTACT: Rgba = GREEN.mix(0.16);
/// Bars of the contacts detected.
pub(crate) const DETECTED: Rgb = BLUE;

/// Width of a curve in CSS pixels.
pub(crate) const CURVE_PX: f64 = 1.75;
/// Width of axes and rules in CSS pixels.
pub(crate) const HAIRLINE_PX: f64 = 1.0;
/// Half the size of a marker in CSS pixels.
pub(crate) const MARKER_PX: f64 = 4.0;

/// Titles of panels.
pub(crate) const PANEL_TITLE: Lettering = Lettering { size_px: 13.5, bold: true, color: INK, align: Align::Left };
/// Names of axes and of legend entries.
pub(crate) const LABEL: Lettering = Lettering { size_px: 12.5, bold: false, color: INK, align: Align::Left };
/// Numbers along axes and annotations.
pub(crate) const SMALL: Lettering = Lettering { size_px: 11.5, bold: false, color: MUTED, align: Align::Left };

impl Lettering {
    /// The same lettering with another alignment.
    pub(crate) fn aligned(self, align: Align) -> Self {
        Self { align, ..self }
    }
}

/// Shape of a marker.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Shape {
    Disc,
    Square,
    Triangle,
    Diamond,
    Nabla,
}

const SHAPES: [Shape; 5] = [Shape::Disc, Shape::Square, Shape::Triangle, Shape::Diamond, Shape::Nabla];

/// Colour and marker of a curve.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Look {
    /// Colour of its curves and markers.
    pub(crate) color: Rgb,
    shape: Shape,
}

impl Look {
    /// The look at a place among the curves of a picture.
    pub(crate) fn of(index: usize) -> Self {
        Self { color: PALETTE[index % PALETTE.len()], shape: SHAPES[index % SHAPES.len()] }
    }

    /// A marker with a white rim; `filled` or only its outline.
    pub(crate) fn mark(self, canvas: &Canvas, at: Px, half_px: f64, filled: bool) -> Result<()> {
        let white = Rgb::WHITE;
        self.blot(canvas, at, half_px + 1.0, white)?;
        self.blot(canvas, at, half_px, self.color)?;
        if !filled {
            self.blot(canvas, at, half_px - 1.5, white)?;
        }
        Ok(())
    }

    fn blot(self, canvas: &Canvas, (x, y): Px, half_px: f64, color: impl Into<Rgba>) -> Result<()> {
        let corners = |corners: &[(f64, f64)]| -> Vec<Px> {
            corners.iter().map(|(dx, dy)| (x + dx * half_px, y + dy * half_px)).collect()
        };
        // The factors give all shapes about the area of the disc.
        match self.shape {
            Shape::Disc => canvas.disc((x, y), half_px, color),
            Shape::Square => {
                canvas.polygon(&corners(&[(-0.88, -0.88), (0.88, -0.88), (0.88, 0.88), (-0.88, 0.88)]), color)
            }
            Shape::Triangle => canvas.polygon(&corners(&[(0.0, -1.25), (1.2, 0.9), (-1.2, 0.9)]), color),
            Shape::Diamond => canvas.polygon(&corners(&[(0.0, -1.3), (1.2, 0.0), (0.0, 1.3), (-1.2, 0.0)]), color),
            Shape::Nabla => canvas.polygon(&corners(&[(0.0, 1.25), (1.2, -0.9), (-1.2, -0.9)]), color),
        }
    }
}

/// Paints the sign of a legend entry, centred on a point.
type Sign<'a> = dyn Fn(&Canvas, Px) -> Result<()> + 'a;

/// One entry of a legend.
pub(crate) struct LegendEntry<'a> {
    text: &'a str,
    /// Its sign, 26 px wide.
    sign: Box<Sign<'a>>,
}

impl<'a> LegendEntry<'a> {
    /// A line with a marker on it.
    pub(crate) fn curve(text: &'a str, look: Look) -> Self {
        let sign = move |canvas: &Canvas, (x, y): Px| {
            canvas.line(&[(x - 12.0, y), (x + 12.0, y)], look.color, CURVE_PX)?;
            look.mark(canvas, (x, y), MARKER_PX, true)
        };
        Self { text, sign: Box::new(sign) }
    }

    /// A line.
    pub(crate) fn line(text: &'a str, color: Rgb, width_px: f64) -> Self {
        let sign = move |canvas: &Canvas, (x, y): Px| canvas.line(&[(x - 12.0, y), (x + 12.0, y)], color, width_px);
        Self { text, sign: Box::new(sign) }
    }

    /// A part of a line with its ends.
    pub(crate) fn stretch(text: &'a str, color: Rgb, width_px: f64) -> Self {
        let sign = move |canvas: &Canvas, (x, y): Px| {
            let ends = [(x - 10.0, y), (x + 10.0, y)];
            canvas.line(&ends, color, width_px)?;
            ends.into_iter().try_for_each(|end| stretch_end(canvas, end, color))
        };
        Self { text, sign: Box::new(sign) }
    }

    /// A band of each colour.
    pub(crate) fn bands(text: &'a str, colors: Vec<Rgba>) -> Self {
        let sign = move |canvas: &Canvas, (x, y): Px| {
            let height = 14.0 / colors.len() as f64;
            for (index, color) in colors.iter().enumerate() {
                let top = y - 7.0 + height * index as f64;
                let corners = [(-12.0, 0.0), (12.0, 0.0), (12.0, height), (-12.0, height)];
                canvas.polygon(&corners.map(|(dx, dy)| (x + dx, top + dy)), *color)?;
            }
            Ok(())
        };
        Self { text, sign: Box::new(sign) }
    }

    /// A dashed line.
    pub(crate) fn dashes(text: &'a str, color: Rgb) -> Self {
        let sign = move |canvas: &Canvas, (x, y): Px| canvas.dashes((x - 12.0, y), (x + 12.0, y), color);
        Self { text, sign: Box::new(sign) }
    }

    /// A marker.
    pub(crate) fn marker(text: &'a str, look: Look, filled: bool) -> Self {
        let sign = move |canvas: &Canvas, at: Px| look.mark(canvas, at, MARKER_PX, filled);
        Self { text, sign: Box::new(sign) }
    }
}

/// The end of a part of a line: a disc with a white rim.
pub(crate) fn stretch_end(canvas: &Canvas, at: Px, color: Rgb) -> Result<()> {
    canvas.disc(at, 4.25, Rgb::WHITE)?;
    canvas.disc(at, 3.25, color)
}

/// Draws the entries in rows 22 px apart, as many in a row as fit. Returns the height of the last row.
pub(crate) fn legend(canvas: &Canvas, (left, top): Px, entries: &[LegendEntry]) -> Result<f64> {
    let (mut x, mut y) = (left, top);
    for entry in entries {
        let width = 32.0 + canvas.text_width_px(entry.text, LABEL) + 24.0;
        if x > left && x + width > canvas.width_px() {
            (x, y) = (left, y + 22.0);
        }
        (entry.sign)(canvas, (x + 13.0, y))?;
        canvas.text(entry.text, (x + 32.0, y), LABEL)?;
        x += width;
    }
    Ok(y)
}

/// Least distance between the middles of labels beside a panel.
const LABEL_STEP_PX: f64 = 17.0;

/// Writes names beside curves: each at the height of its curve's end or as near as the other names allow, with a line to it.
/// `across` is where the lines start and the names begin, `within` the upper and lower end of the column of names; an entry
/// has the height of its curve's end, its name and the colour of the line.
pub(crate) fn beside(
    canvas: &Canvas,
    across: (f64, f64),
    within: (f64, f64),
    mut entries: Vec<(f64, &str, Rgb)>,
) -> Result<()> {
    entries.sort_by(|a, b| a.0.total_cmp(&b.0));
    let ends: Vec<f64> = entries.iter().map(|entry| entry.0).collect();
    for ((end_y, name, color), y) in entries.into_iter().zip(spread(&ends, LABEL_STEP_PX, within)) {
        let line = [(across.0 + 3.0, end_y), (across.0 + 8.0, end_y), (across.1 - 8.0, y), (across.1 - 3.0, y)];
        canvas.line(&line, color, CURVE_PX)?;
        canvas.text(name, (across.1, y), LABEL)?;
    }
    Ok(())
}

/// Ascending places at least `step` apart and within the limits, each as near to its wish as those before it allow.
fn spread(wishes: &[f64], step: f64, (first, last): (f64, f64)) -> Vec<f64> {
    let mut places: Vec<f64> = wishes.to_vec();
    let mut least = first;
    for place in &mut places {
        *place = place.max(least);
        least = *place + step;
    }
    let mut most = last;
    for place in places.iter_mut().rev() {
        *place = place.min(most);
        most = *place - step;
    }
    places
}

/// A name of the data in words.
pub(crate) fn plain(name: &str) -> String {
    name.replace('_', " ")
}

/// A positive number with two significant digits, without an exponent.
pub(crate) fn two_digits(value: f64) -> String {
    let decimals = (1.0 - value.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.decimals$}")
}

/// A number with three significant digits; one below a ten-thousandth as a multiple of a power of ten.
pub(crate) fn three_digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let text = if value.abs() < 1e-4 {
        format!("{value:.2e}").replacen('e', "·10^", 1)
    } else {
        let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
        format!("{value:.decimals$}")
    };
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_labels_keep_their_distance_and_stay_within_the_column() {
        assert_eq!(spread(&[5.0, 50.0], 10.0, (0.0, 100.0)), [5.0, 50.0]);
        assert_eq!(spread(&[5.0, 6.0, 98.0, 99.0], 10.0, (0.0, 100.0)), [5.0, 15.0, 90.0, 100.0]);
    }

    #[test]
    fn verif_three_digits_are_significant() {
        let printed = [0.0, 1.0, 0.02224, -151.6, 4.26e-12, -6.4e-16].map(three_digits);
        assert_eq!(printed, ["0", "1.00", "0.0222", "−152", "4.26·10^−12", "−6.40·10^−16"]);
    }
}
