//! Device side of a pseudo-terminal.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt;
use std::path::PathBuf;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use super::closings::Closings;
use crate::Error;

/// Pseudo-terminal that acts as a serial port.
#[derive(Debug)]
pub(super) struct Pty {
    device: OwnedFd,
    closings: Closings,
    /// Path of the port.
    pub(super) path: PathBuf,
}

/// Result of a read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Heard {
    /// Number of bytes.
    Bytes(usize),
    /// No bytes; the port is open.
    Nothing,
    /// The port is closed, or was closed and reopened.
    Closed,
}

impl Pty {
    /// Creates one that transmits bytes unchanged.
    ///
    /// # Errors
    /// If the system cannot create it.
    pub(super) fn open() -> Result<Self, Error> {
        let open = || -> Result<Self, Errno> {
            let device = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
            grantpt(&device)?;
            unlockpt(&device)?;
            let path = PathBuf::from(std::ffi::OsString::from_vec(ptsname(&device, Vec::new())?.into_bytes()));
            // Raw mode: no echo and no conversion of line ends.
            let mut settings = tcgetattr(&device)?;
            settings.make_raw();
            tcsetattr(&device, OptionalActions::Now, &settings)?;
            fcntl_setfl(&device, fcntl_getfl(&device)? | OFlags::NONBLOCK)?;
            // The system reports a closed port only after the first close.
            drop(rustix::fs::open(&path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?);
            let closings = Closings::of(&path)?;
            Ok(Self { device, closings, path })
        };
        open().map_err(io::Error::from).map_err(Error::system("pseudo-terminal"))
    }

    /// Reads the pending bytes, with a timeout.
    pub(super) fn read(&self, bytes: &mut [u8], patience: Duration) -> Result<Heard, Error> {
        let events = self.poll(PollFlags::IN, patience)?;
        // The pending bytes may be of the next client.
        if self.closings.any().map_err(io::Error::from).map_err(Error::system("pseudo-terminal"))? {
            return Ok(Heard::Closed);
        }
        if !events.contains(PollFlags::IN) {
            return Ok(if events.contains(PollFlags::HUP) { Heard::Closed } else { Heard::Nothing });
        }
        match rustix::io::read(&self.device, bytes) {
            Ok(count) => Ok(Heard::Bytes(count)),
            Err(Errno::AGAIN | Errno::INTR) => Ok(Heard::Nothing),
            Err(Errno::IO) => Ok(Heard::Closed),
            Err(error) => Err(Error::system("pseudo-terminal")(error.into())),
        }
    }

    /// Writes as many bytes as there is room for. Returns their number.
    pub(super) fn write(&self, bytes: &[u8]) -> Result<usize, Error> {
        match rustix::io::write(&self.device, bytes) {
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            Err(error) => Err(Error::system("pseudo-terminal")(error.into())),
        }
    }

    /// Whether the port is open.
    pub(super) fn is_open(&self) -> Result<bool, Error> {
        Ok(!self.poll(PollFlags::empty(), Duration::ZERO)?.contains(PollFlags::HUP))
    }

    fn poll(&self, wanted: PollFlags, patience: Duration) -> Result<PollFlags, Error> {
        let mut polled = [PollFd::new(&self.device, wanted)];
        let patience = Timespec::try_from(patience).expect("a moment");
        match poll(&mut polled, Some(&patience)) {
            Ok(_) => Ok(polled[0].revents()),
            Err(Errno::INTR) => Ok(PollFlags::empty()),
            Err(error) => Err(Error::system("pseudo-terminal")(error.into())),
        }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn verif_a_port_reopened_at_once_counts_as_closed() {
        let pty = Pty::open().expect("a pseudo-terminal");
        let open = || rustix::fs::open(&pty.path, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).expect("open");
        let mut bytes = [0; 16];
        let mut heard = || pty.read(&mut bytes, Duration::ZERO).expect("read");
        let first = open();
        assert_eq!(heard(), Heard::Nothing);
        drop(first);
        let next = open();
        rustix::io::write(&next, b"hello\n").expect("written");
        assert_eq!(heard(), Heard::Closed);
        // The system delivers bytes with a delay.
        while heard() != Heard::Bytes(6) {}
    }
}
