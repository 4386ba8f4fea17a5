//! Strict JSON: each key once, no list where an object is expected, and quotation of foreign text on one line.
//!
//! `serde_json` accepts two inputs that are almost always mistakes: an object that holds a key twice, of which it keeps the last, and a list in place of an object, whose
//! values serde assigns to the fields in their order of declaration. [`parse_json`] refuses both and names the place.
//!
//! ```
//! use serde::{Deserialize, Serialize};
//! use strict_json::parse_json;
//!
//! #[derive(Deserialize, Serialize)]
//! struct Offset {
//!     x_m: f64,
//!     y_m: f64,
//! }
//!
//! assert_eq!(parse_json::<Offset>(br#"{"x_m": 0.001, "y_m": 0}"#)?.x_m, 0.001);
//! let list = parse_json::<Offset>(b"[0.001, 0]").map(|_| ()).unwrap_err();
//! assert_eq!(list.to_string(), "the whole: found a list, expected an object");
//! assert!(parse_json::<Offset>(br#"{"x_m": 1, "x_m": 2, "y_m": 0}"#).is_err());
//! # Ok::<(), serde_json::Error>(())
//! ```

mod keys_once;
mod lists;
mod parse;
mod quote;

pub use lists::list_for_object;
pub use parse::parse_json;
pub use quote::{one_line, shown};
