//! Whiskers, recordings and estimators in space.

mod calibration;
mod estimator;
mod pose;
mod replay;
mod returned;
mod rod;
mod sensor;
mod surface;
mod trace;
mod trial;

pub(crate) use calibration::{
    SpatialCalibration, SpatialPrediction, fit_spatial_calibration, load_spatial_calibration,
};
pub(crate) use estimator::{SpatialEstimate, SpatialEstimator, spatial_estimators};
pub(crate) use replay::SpatialReplay;
pub(crate) use rod::{Rod, SpatialContacts};
pub(crate) use sensor::BendingSensor;
pub(crate) use surface::SpatialSurface;
pub(crate) use trace::SpatialTrace;
pub(crate) use trial::{SpatialTrial, spatial_cramer_rao_bound};
