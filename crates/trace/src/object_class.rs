//! Classes of objects by how they can be touched.

use serde::{Deserialize, Serialize};

/// Shape of the simulated pins.
const PIN: &str = "pin";

/// Shape that stands for the objects of a recording of several whiskers.
const SEVERAL: &str = "several";

/// Shape of the simulated circles.
const CIRCLE: &str = "circle";

/// Part of the names of round objects in recordings that do not state a class.
const RECORDED_ROUND: &str = "cylinder";

/// Class of the object of a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ObjectClass {
    /// A pin, touched in one place.
    Pin,
    /// Several objects, whose outlines belong to a map.
    Several,
    /// An object that is circular wherever it is touched.
    Round,
    /// Any other object with an outline.
    Other,
}

impl ObjectClass {
    /// Class of an object by its shape, or by its name in a recording that does not state a class.
    pub fn of_shape(shape: &str) -> Self {
        match shape {
            PIN => Self::Pin,
            SEVERAL => Self::Several,
            CIRCLE => Self::Round,
            recorded if recorded.contains(RECORDED_ROUND) => Self::Round,
            _ => Self::Other,
        }
    }

    /// Whether one whisker can trace an outline of the object.
    pub fn has_outline(self) -> bool {
        matches!(self, Self::Round | Self::Other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_shapes_and_recorded_names_have_their_class() {
        let classes = [
            ("pin", ObjectClass::Pin),
            ("several", ObjectClass::Several),
            ("circle", ObjectClass::Round),
            ("smallcylinder", ObjectClass::Round),
            ("square", ObjectClass::Other),
            ("ellipse", ObjectClass::Other),
        ];
        for (shape, class) in classes {
            assert_eq!(ObjectClass::of_shape(shape), class, "{shape}");
        }
        assert!(ObjectClass::Round.has_outline() && !ObjectClass::Pin.has_outline());
    }
}
