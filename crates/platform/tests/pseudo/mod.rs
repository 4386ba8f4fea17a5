//! Pseudo-terminals with the test in the role of the device.

use std::fs::File;
use std::os::fd::OwnedFd;

use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// The device's side.
pub(crate) type Device = File;

/// Path of a port, its device side, and a handle that keeps the port open.
pub(crate) fn pair() -> (String, Device, OwnedFd) {
    let device = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).expect("a pseudo-terminal");
    grantpt(&device).and_then(|()| unlockpt(&device)).expect("granted");
    let path = ptsname(&device, Vec::new()).expect("a name").into_string().expect("text");
    let mut settings = tcgetattr(&device).expect("settings");
    settings.make_raw();
    tcsetattr(&device, OptionalActions::Now, &settings).expect("set");
    let port = rustix::fs::open(&path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty()).expect("open");
    (path, device.into(), port)
}
