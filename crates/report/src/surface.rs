//! What a figure is drawn on: plotters' SVG and bitmap backends behind one type, so that one drawing routine makes
//! both files and both look alike.

use std::io;

use plotters::backend::{BitMapBackend, SVGBackend};
use plotters_backend::text_anchor::VPos;
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind, FontTransform,
};

/// Drawing units in a CSS pixel. plotters places everything on whole units; units finer than pixels keep curves smooth.
pub(crate) const UNITS_PER_PX: u32 = 4;

/// plotters measures a font from ascender to descender and writes this fraction of it as the SVG font size.
pub(crate) const FONT_HEIGHT_EM: f64 = 1.24;

/// plotters' rasteriser puts the baseline this far below the top of the text box, which is 1 em high.
const RASTER_BASELINE_EM: f64 = FONT_HEIGHT_EM / 2.0;

/// The error of either backend.
pub(crate) type SurfaceError = DrawingErrorKind<io::Error>;

/// A backend of plotters.
pub(crate) enum Surface<'a> {
    /// Writes SVG elements.
    Svg(SVGBackend<'a>),
    /// Paints pixels.
    Raster(BitMapBackend<'a>),
}

/// Calls the same method of whichever backend it is.
macro_rules! forward {
    ($surface:expr, $backend:ident => $call:expr) => {
        match $surface {
            Surface::Svg($backend) => $call.map_err(unify),
            Surface::Raster($backend) => $call.map_err(unify),
        }
    };
}

fn unify<E: std::error::Error + Send + Sync + 'static>(error: DrawingErrorKind<E>) -> SurfaceError {
    match error {
        DrawingErrorKind::DrawingError(cause) => DrawingErrorKind::DrawingError(io::Error::other(cause)),
        DrawingErrorKind::FontError(cause) => DrawingErrorKind::FontError(cause),
    }
}

/// Distance of the baseline below the anchor as [`svg_baselines`] writes it, in em: capitals and digits are then
/// centred on the anchor, or stand under or on it.
fn baseline_em(anchor: VPos) -> f64 {
    match anchor {
        VPos::Top => 0.73,
        VPos::Center => 0.36,
        VPos::Bottom => -0.27,
    }
}

/// Replaces the baselines that plotters writes into SVG, which depend on the reader's font metrics, by our own.
pub(crate) fn svg_baselines(svg: &str) -> String {
    [("0.76em", VPos::Top), ("0.5ex", VPos::Center), ("-0.5ex", VPos::Bottom)].iter().fold(
        svg.to_owned(),
        |svg, (written, anchor)| {
            let ours = format!("dy=\"{}em\"", baseline_em(*anchor));
            svg.replace(&format!("dy=\"{written}\""), &ours)
        },
    )
}

impl DrawingBackend for Surface<'_> {
    type ErrorType = io::Error;

    fn get_size(&self) -> (u32, u32) {
        match self {
            Self::Svg(backend) => backend.get_size(),
            Self::Raster(backend) => backend.get_size(),
        }
    }

    fn ensure_prepared(&mut self) -> Result<(), SurfaceError> {
        forward!(self, backend => backend.ensure_prepared())
    }

    fn present(&mut self) -> Result<(), SurfaceError> {
        forward!(self, backend => backend.present())
    }

    fn draw_pixel(&mut self, at: BackendCoord, color: BackendColor) -> Result<(), SurfaceError> {
        forward!(self, backend => backend.draw_pixel(at, color))
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: BackendCoord,
        bottom_right: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Result<(), SurfaceError> {
        forward!(self, backend => backend.draw_rect(upper_left, bottom_right, style, fill))
    }

    /// A path with round joins. plotters' own rasteriser turns a thick path into one polygon, which shows holes
    /// wherever a noisy path crosses itself.
    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Result<(), SurfaceError> {
        match self {
            Self::Svg(backend) => backend.draw_path(path, style).map_err(unify),
            Self::Raster(backend) => {
                let points: Vec<_> = path.into_iter().collect();
                let half_width = f64::from(style.stroke_width()) / 2.0;
                for pair in points.windows(2) {
                    backend.fill_polygon(thick_segment(pair[0], pair[1], half_width), style).map_err(unify)?;
                }
                for &joint in &points {
                    backend.draw_circle(joint, half_width as u32, style, true).map_err(unify)?;
                }
                Ok(())
            }
        }
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        center: BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Result<(), SurfaceError> {
        forward!(self, backend => backend.draw_circle(center, radius, style, fill))
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Result<(), SurfaceError> {
        forward!(self, backend => backend.fill_polygon(corners, style))
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        (x, y): BackendCoord,
    ) -> Result<(), SurfaceError> {
        match self {
            Self::Svg(backend) => backend.draw_text(text, style, (x, y)).map_err(unify),
            Self::Raster(backend) => {
                let anchor = style.anchor().v_pos;
                let drawn_em = match anchor {
                    VPos::Top => RASTER_BASELINE_EM,
                    VPos::Center => RASTER_BASELINE_EM - 0.5,
                    VPos::Bottom => RASTER_BASELINE_EM - 1.0,
                };
                let em = style.size() / FONT_HEIGHT_EM;
                let shift = ((baseline_em(anchor) - drawn_em) * em).round() as i32;
                let at = match style.transform() {
                    FontTransform::None => (x, y + shift),
                    FontTransform::Rotate90 => (x - shift, y),
                    FontTransform::Rotate180 => (x, y - shift),
                    FontTransform::Rotate270 => (x + shift, y),
                };
                backend.draw_text(text, style, at).map_err(unify)
            }
        }
    }
}

/// Corners of a straight stroke. Empty for a stroke without length.
fn thick_segment(from: BackendCoord, to: BackendCoord, half_width: f64) -> Vec<BackendCoord> {
    let (dx, dy) = (f64::from(to.0 - from.0), f64::from(to.1 - from.1));
    let length = dx.hypot(dy);
    if length == 0.0 {
        return Vec::new();
    }
    let (nx, ny) = (-dy / length * half_width, dx / length * half_width);
    let corner = |(x, y): BackendCoord, side: f64| {
        ((f64::from(x) + side * nx).round() as i32, (f64::from(y) + side * ny).round() as i32)
    };
    vec![corner(from, 1.0), corner(to, 1.0), corner(to, -1.0), corner(from, -1.0)]
}
