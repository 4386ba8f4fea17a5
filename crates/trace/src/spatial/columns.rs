//! Columns of a trace in space.

use crate::table::{FARTHEST_M, LARGEST};

/// Column names and the number of decimals written for each.
pub const SPATIAL_COLUMNS: [(&str, usize); 41] = [
    ("t_s", 6),
    ("base_x_m", 10),
    ("base_y_m", 10),
    ("base_z_m", 10),
    ("base_qw", 12),
    ("base_qx", 12),
    ("base_qy", 12),
    ("base_qz", 12),
    ("base_vx_m_s", 10),
    ("base_vy_m_s", 10),
    ("base_vz_m_s", 10),
    ("base_wx_rad_s", 10),
    ("base_wy_rad_s", 10),
    ("base_wz_rad_s", 10),
    ("moment_x_n_m", 15),
    ("moment_y_n_m", 15),
    ("moment_z_n_m", 15),
    ("force_x_n", 12),
    ("rotation_yaw_rad", 10),
    ("rotation_pitch_rad", 10),
    ("rotation_twist_rad", 10),
    ("truth_touching", 0),
    ("truth_tip", 0),
    ("truth_split", 0),
    ("truth_feature", 0),
    ("truth_contact_x_m", 10),
    ("truth_contact_y_m", 10),
    ("truth_contact_z_m", 10),
    ("truth_surface_x_m", 10),
    ("truth_surface_y_m", 10),
    ("truth_surface_z_m", 10),
    ("truth_normal_x", 10),
    ("truth_normal_y", 10),
    ("truth_normal_z", 10),
    ("truth_arc_m", 10),
    ("truth_force_x_n", 12),
    ("truth_force_y_n", 12),
    ("truth_force_z_n", 12),
    ("truth_tangent_x", 10),
    ("truth_tangent_y", 10),
    ("truth_tangent_z", 10),
];

/// First columns of the quantities that consist of several.
pub(super) const POSITION: usize = 1;
pub(super) const QUATERNION: usize = 4;
pub(super) const LINEAR: usize = 8;
pub(super) const ANGULAR: usize = 11;
pub(super) const MOMENT: usize = 14;
pub(super) const AXIAL: usize = 17;
pub(super) const ROTATION: usize = 18;
pub(super) const TOUCHING: usize = 21;
pub(super) const TIP: usize = 22;
pub(super) const SPLIT: usize = 23;
pub(super) const FEATURE: usize = 24;
pub(super) const CONTACT: usize = 25;
pub(super) const SURFACE: usize = 28;
pub(super) const NORMAL: usize = 31;
pub(super) const ARC: usize = 34;
pub(super) const FORCE: usize = 35;
pub(super) const TANGENT: usize = 38;

/// Largest magnitude in a column, as in a planar trace.
pub(super) fn most(column: usize) -> f64 {
    match SPATIAL_COLUMNS[column].0 {
        "t_s" => 1e12,
        name if name.ends_with("_m") && !name.ends_with("_n_m") => FARTHEST_M,
        _ => LARGEST,
    }
}
