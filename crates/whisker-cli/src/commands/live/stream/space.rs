//! Estimators of space.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, bail};
use live::counts::{BendingCounts, Conversion, ZEROING_S};
use live::wire::{self, BadLine, SpatialGiven, SpatialPriorLine};
use live::{LiveEstimator, Spatial, SpatialPoses, Timing, noise_n_m};
use nalgebra::Vector2;
use serde_json::Value;
use testbed::protocol::space::SPATIAL_PROTOCOL;
use testbed::space;
use trace::{BendingSensor, SpatialCalibrationFile};
use whisker::space::estimators::{Knowledge as SpatialKnowledge, SpatialEstimatorRow};
use whisker::space::sensor::CalibratedSpace;

use super::method::{Begun, Method, Taken, check_counts, check_noise, check_prior};
use crate::commands::live::sink::ZEROING;

/// A calibration in space and its tabulated sensor model.
pub(super) struct Tabulated {
    file: SpatialCalibrationFile,
    calibrated: Arc<CalibratedSpace>,
}

/// An estimator of space with its settings.
pub(super) struct OfSpace {
    pub(super) row: &'static SpatialEstimatorRow,
    pub(super) config: Value,
}

impl Method for OfSpace {
    type Kind = Spatial;
    type Motion = SpatialPoses;
    type Prior = SpatialPriorLine;
    type Calibration = Tabulated;
    type Given = SpatialGiven;
    type Conversion = Result<BendingCounts, String>;

    const PROTOCOL: u32 = SPATIAL_PROTOCOL;

    fn read(path: &Path) -> anyhow::Result<Tabulated> {
        let file = space::replay::read_calibration(path)?;
        let calibrated = space::replay::read_by(&file.calibrated(path, None)?, file.front_end_sensor());
        Ok(Tabulated { file, calibrated })
    }

    fn parse(line: &str) -> Result<wire::SpatialLine, BadLine> {
        wire::parse_in_space(line)
    }

    fn name(prior: &SpatialPriorLine) -> Option<&str> {
        prior.name.as_deref()
    }

    fn begin(
        &self,
        Tabulated { file, calibrated }: &Tabulated,
        path: &Path,
        prior: &SpatialPriorLine,
        timing: Timing,
    ) -> anyhow::Result<Begun<Self>> {
        check_prior((prior.protocol, Self::PROTOCOL), prior.rate_hz)?;
        let of_sensor = file.sensor.map(|sensor| sensor.noise_sd_n_m);
        check_noise(prior.noise_sd_n_m, of_sensor, file.largest_reading_n_m)?;
        let noise_sd_n_m = noise_n_m(prior.noise_sd_n_m, of_sensor).with_context(|| {
            format!(
                "noise_sd_n_m: found none, expected the standard deviation of the noise (N m), since the calibration {} has no \
                 `sensor` that states it",
                path.display()
            )
        })?;
        check_counts(prior.zeroing_s, prior.modulo)?;
        let for_counts = [("zeroing_s", prior.zeroing_s), ("modulo", prior.modulo)];
        if let Some((key, _)) = for_counts.iter().find(|(_, stated)| stated.is_some() && file.sensor.is_none()) {
            let path = path.display();
            bail!("{key}: found a setting of counts, expected none, since the calibration {path} has no `sensor`");
        }
        let is_other = prior.whisker.as_ref().is_some_and(|stated| *stated != file.whisker)
            || prior.suspension.is_some_and(|stated| stated != file.suspension)
            || prior.poisson_ratio.is_some_and(|stated| stated != file.poisson_ratio);
        if is_other {
            bail!(
                "whisker, suspension or poisson_ratio: found other parameters than those of {}, expected the same",
                path.display()
            );
        }
        let knowledge =
            Arc::new(SpatialKnowledge { calibrated: calibrated.clone(), noise_sd_n_m, rate_hz: prior.rate_hz });
        let (row, config, of_build) = (self.row, self.config.clone(), knowledge.clone());
        let build = move || space::replay::build(row, &config, &of_build);
        let zeroing_s = prior.zeroing_s.unwrap_or(ZEROING_S);
        let conversion = |sensor: BendingSensor| {
            let sensor = BendingSensor { noise_sd_n_m, ..sensor };
            let largest_n_m = file.largest_reading_n_m;
            BendingCounts::new(sensor, largest_n_m, [0, 1], prior.modulo, zeroing_s, timing, prior.rate_hz)
        };
        let counts = file.sensor.map(conversion).ok_or_else(|| {
            format!(
                "counts: found those of a whisker whose calibration {} has no sensor, expected moment_y_n_m and moment_z_n_m, or \
                 a calibration that `whisker fit` made of imported recordings",
                path.display()
            )
        });
        Ok((LiveEstimator::in_space(Box::new(build), &knowledge, timing)?, counts))
    }

    fn convert(
        conversion: &mut Self::Conversion,
        t_s: f64,
        given: SpatialGiven,
        at_s: f64,
    ) -> Result<Taken<Vector2<f64>>, String> {
        match given {
            SpatialGiven::Moments(moments_n_m) => Ok(Taken::Reading(moments_n_m)),
            SpatialGiven::Counts(counts) => {
                let conversion = conversion.as_mut().map_err(|reason| reason.clone())?;
                let moments_n_m = conversion.moments_n_m(t_s, counts, at_s);
                Ok(moments_n_m.map_or(Taken::LeftOut(ZEROING), Taken::Reading))
            }
        }
    }

    fn zeroings_repeated(conversion: &Self::Conversion) -> u64 {
        conversion.as_ref().map_or(0, Conversion::zeroings_repeated)
    }
}
