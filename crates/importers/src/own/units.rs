//! Units of a mapping.

use serde::{Deserialize, Serialize};

/// Unit of a physical dimension.
pub(crate) trait Unit: Copy {
    /// Number of SI units in one of these.
    fn si(self) -> f64;
}

macro_rules! units {
    ($(#[$about:meta])* $name:ident { $($variant:ident = $text:literal is $si:expr,)* }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
        pub(crate) enum $name {
            $(#[serde(rename = $text)] $variant,)*
        }

        impl Unit for $name {
            fn si(self) -> f64 {
                match self {
                    $(Self::$variant => $si,)*
                }
            }
        }
    };
}

units! {
    /// Length.
    Length { M = "m" is 1.0, Cm = "cm" is 1e-2, Mm = "mm" is 1e-3, Um = "um" is 1e-6, Inch = "in" is 0.0254, }
}

units! {
    /// Angle.
    Angle { Rad = "rad" is 1.0, Mrad = "mrad" is 1e-3, Deg = "deg" is std::f64::consts::PI / 180.0, }
}

units! {
    /// Time.
    Time { S = "s" is 1.0, Ms = "ms" is 1e-3, Us = "us" is 1e-6, Ns = "ns" is 1e-9, }
}

units! {
    /// Moment, or the raw unit of a sensor (`counts`), which a characteristic converts.
    Reading {
        NewtonMetre = "N m" is 1.0,
        NewtonCentimetre = "N cm" is 1e-2,
        NewtonMillimetre = "N mm" is 1e-3,
        MillinewtonMetre = "mN m" is 1e-3,
        MillinewtonMillimetre = "mN mm" is 1e-6,
        MicronewtonMetre = "uN m" is 1e-6,
        Counts = "counts" is 1.0,
    }
}
