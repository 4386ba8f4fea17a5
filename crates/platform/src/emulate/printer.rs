//! Emulated printer: its port and its firmware.

use std::time::Duration;

use super::Shared;
use super::firmware::Firmware;
use super::pty::{Heard, Pty};
use crate::Error;
use crate::lines::Lines;
use crate::rig::Bed;

/// Time step of the firmware.
const TICK: Duration = Duration::from_millis(5);

/// Runs the firmware until the emulation ends.
pub(super) fn run(pty: &Pty, bed: Bed, shared: &Shared) -> Result<(), Error> {
    let (mut firmware, mut lines) = (Firmware::new(bed), Lines::default());
    let (mut bytes, mut words) = ([0; 4096], Vec::new());
    let mut was_open = false;
    while !shared.ends() {
        let heard = pty.read(&mut bytes, TICK)?;
        let now_s = shared.now_s();
        let mut motion = shared.motion.lock().expect("no holder of the lock panics");
        match heard {
            Heard::Bytes(count) => {
                was_open = true;
                lines.push(&bytes[..count], |line| {
                    firmware.receive(&String::from_utf8_lossy(line.bytes), now_s, &mut motion);
                });
            }
            Heard::Nothing => was_open = true,
            Heard::Closed => {
                // A board restarts when its port is opened; the emulation restarts when it is closed.
                if std::mem::take(&mut was_open) {
                    motion.stop(now_s);
                    (firmware, lines) = (Firmware::new(bed), Lines::default());
                    words.clear();
                }
                drop(motion);
                std::thread::sleep(TICK);
                continue;
            }
        }
        firmware.work(now_s, &mut motion, &mut words);
        drop(motion);
        let written = pty.write(&words)?;
        words.drain(..written);
    }
    Ok(())
}
