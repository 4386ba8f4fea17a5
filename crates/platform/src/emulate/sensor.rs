//! Emulated magnetometer: prints its readings at its rate while its port is open.

use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

use super::pty::Pty;
use super::table::Field;
use super::whisker::Whisker;
use super::{Emulated, Shared};
use crate::Error;

/// Capacity of the output buffer in bytes: further readings are dropped, as on a real port; short delays of the reader
/// are tolerated.
const MOST_WAITING: usize = 1 << 16;

/// Prints readings until the emulation ends.
pub(super) fn run(pty: &Pty, emulated: &Emulated, shared: &Shared) -> Result<(), Error> {
    let format = (emulated.format.build)();
    let mut whisker = Whisker::new(emulated.rig.clone(), emulated.table.clone());
    let mut rng = Pcg64::seed_from_u64(emulated.seed);
    let mut waiting = Vec::new();
    for reading in 0_u64.. {
        let due_s = reading as f64 / emulated.format.rate_hz;
        let early_s = due_s - shared.now_s();
        if early_s > 0.0 {
            thread::sleep(Duration::from_secs_f64(early_s));
        }
        if shared.ends() {
            break;
        }
        let position_mm = shared.motion.lock().expect("no holder of the lock panics").position_mm(due_s);
        let rotation_rad = whisker.rotation_rad(due_s, [1e-3 * position_mm[0], 1e-3 * position_mm[1]]);
        let counts = counts(&emulated.table.field, rotation_rad, &mut rng);
        if !pty.is_open()? {
            waiting.clear();
            continue;
        }
        if waiting.len() < MOST_WAITING {
            format.print(counts, &mut waiting);
            shared.readings.fetch_add(1, Ordering::Relaxed);
        } else {
            shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
        let written = pty.write(&waiting)?;
        waiting.drain(..written);
    }
    Ok(())
}

/// Counts of the magnetometer with noise, modulo 2^16.
fn counts(field: &Field, rotation_rad: f64, rng: &mut Pcg64) -> [u16; 3] {
    std::array::from_fn(|axis| {
        let noise: f64 = field.noise_sd_counts * rng.sample::<f64, _>(StandardNormal);
        let counts = field.rest_counts[axis] + field.counts_per_rad[axis] * rotation_rad + noise;
        // The low 16 bits of the integer.
        counts.round() as i64 as u16
    })
}

#[cfg(test)]
mod tests {
    use super::super::table::tests::small;
    use super::*;

    #[test]
    fn verif_counts_wrap_around() {
        let field = Field { noise_sd_counts: 0.0, ..small().field };
        let mut rng = Pcg64::seed_from_u64(1);
        assert_eq!(counts(&field, 0.0, &mut rng), [25000, 500, 36000]);
        // 500 - 5000 counts.
        assert_eq!(counts(&field, 0.1, &mut rng), [25100, 61036, 36000]);
    }
}
