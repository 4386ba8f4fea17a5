//! The device's side of a pseudo-terminal.

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

/// A pseudo-terminal that looks like a serial port to whoever opens its path.
#[derive(Debug)]
pub(super) struct Pty {
    device: OwnedFd,
    closings: Closings,
    /// What to open.
    pub(super) path: PathBuf,
}

/// What a read brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Heard {
    /// So many bytes.
    Bytes(usize),
    /// Nothing, though somebody has the port open.
    Nothing,
    /// Nobody has the port open, or somebody else than before.
    Nobody,
}

impl Pty {
    /// A new one, which passes bytes as they are.
    ///
    /// # Errors
    /// If the system gives none.
    pub(super) fn open() -> Result<Self, Error> {
        let open = || -> Result<Self, Errno> {
            let device = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
            grantpt(&device)?;
            unlockpt(&device)?;
            let path = PathBuf::from(std::ffi::OsString::from_vec(ptsname(&device, Vec::new())?.into_bytes()));
            // No echo, no line ends turned into others: neither before nor after somebody else has set it.
            let mut settings = tcgetattr(&device)?;
            settings.make_raw();
            tcsetattr(&device, OptionalActions::Now, &settings)?;
            fcntl_setfl(&device, fcntl_getfl(&device)? | OFlags::NONBLOCK)?;
            // Until it was closed for the first time, the system does not say that nobody has it open.
            drop(rustix::fs::open(&path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?);
            let closings = Closings::of(&path)?;
            Ok(Self { device, closings, path })
        };
        open().map_err(io::Error::from).map_err(Error::system("pseudo-terminal"))
    }

    /// Reads what there is, after waiting for it.
    pub(super) fn read(&self, bytes: &mut [u8], patience: Duration) -> Result<Heard, Error> {
        let events = self.poll(PollFlags::IN, patience)?;
        // What waits to be read may be the first words of the next.
        if self.closings.any().map_err(io::Error::from).map_err(Error::system("pseudo-terminal"))? {
            return Ok(Heard::Nobody);
        }
        if !events.contains(PollFlags::IN) {
            return Ok(if events.contains(PollFlags::HUP) { Heard::Nobody } else { Heard::Nothing });
        }
        match rustix::io::read(&self.device, bytes) {
            Ok(count) => Ok(Heard::Bytes(count)),
            Err(Errno::AGAIN | Errno::INTR) => Ok(Heard::Nothing),
            Err(Errno::IO) => Ok(Heard::Nobody),
            Err(error) => Err(Error::system("pseudo-terminal")(error.into())),
        }
    }

    /// Writes as many of these bytes as there is room for, and says how many.
    pub(super) fn write(&self, bytes: &[u8]) -> Result<usize, Error> {
        match rustix::io::write(&self.device, bytes) {
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            Err(error) => Err(Error::system("pseudo-terminal")(error.into())),
        }
    }

    /// Whether somebody has the port open.
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
    fn verif_who_opens_it_next_is_somebody_else_however_soon() {
        let pty = Pty::open().expect("a pseudo-terminal");
        let open = || rustix::fs::open(&pty.path, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).expect("open");
        let mut bytes = [0; 16];
        let mut heard = || pty.read(&mut bytes, Duration::ZERO).expect("read");
        let first = open();
        assert_eq!(heard(), Heard::Nothing);
        drop(first);
        let next = open();
        rustix::io::write(&next, b"hello\n").expect("written");
        assert_eq!(heard(), Heard::Nobody);
        // The system hands bytes on in its own time.
        while heard() != Heard::Bytes(6) {}
    }
}
