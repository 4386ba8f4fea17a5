//! Topics of the truth of a trace, beside those of [`bag::topics`].

pub(super) const TOUCHING: &str = "/truth/touching";
pub(super) const TIP: &str = "/truth/tip";
pub(super) const SPLIT: &str = "/truth/split";
pub(super) const CONTACT: &str = "/truth/contact";
pub(super) const SURFACE: &str = "/truth/surface";
pub(super) const ARC: &str = "/truth/arc_m";
pub(super) const FORCE: &str = "/truth/force_n";
pub(super) const TANGENT: &str = "/truth/tangent_rad";
