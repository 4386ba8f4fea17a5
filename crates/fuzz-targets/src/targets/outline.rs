//! Outline of an object.

use trace::Outline;
use whisker::frames::Point;

use crate::properties::one_error;
use crate::scratch;

pub(super) fn run(bytes: &[u8]) {
    let read = |bytes: &[u8]| {
        one_error(Outline::read(&scratch::file("untrusted.contour.csv", bytes)), "untrusted.contour.csv")
    };
    let Some(outline) = read(bytes) else { return };
    outline.middle();
    outline.distance_m(Point::new(0.01, 0.02));
    let text = outline.to_csv();
    let again = read(text.as_bytes()).expect("written data can be read");
    assert_eq!(again.to_csv(), text);
    assert_eq!(again.vertices().len(), outline.vertices().len());
}
