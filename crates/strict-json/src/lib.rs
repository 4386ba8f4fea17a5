//! Strict JSON parsing: unique keys, and no list where an object is expected.
//!
//! `serde_json` accepts two inputs that are almost always mistakes: an object with a duplicate key, of which it keeps
//! the last value, and a list where a struct is expected, whose items it assigns to the fields in declaration order.
//! [`parse_json`] rejects both with their place. [`reason`] states an error of the parser in terms of JSON. [`one_line`] and
//! [`shown`] quote untrusted text in messages, [`shown_number`] numbers.
//!
//! In the following example, a struct is parsed from an object; a list and a duplicate key are rejected:
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
mod reason;

pub use lists::list_for_object;
pub use parse::parse_json;
pub use quote::{one_line, shown, shown_number};
pub use reason::reason;
