//! Detection of a closed port, even if it was reopened at once. Polling alone would detect only whether the port is
//! open at present.

#[cfg(target_os = "linux")]
mod watched {
    use std::os::fd::OwnedFd;
    use std::path::Path;

    use rustix::fs::inotify::{CreateFlags, WatchFlags, add_watch, init};
    use rustix::io::{Errno, read};

    /// Close events of a port, from inotify.
    #[derive(Debug)]
    pub(in super::super) struct Closings(OwnedFd);

    impl Closings {
        /// Events from now on.
        pub(in super::super) fn of(port: &Path) -> Result<Self, Errno> {
            let watch = init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)?;
            add_watch(&watch, port, WatchFlags::CLOSE_WRITE | WatchFlags::CLOSE_NOWRITE)?;
            Ok(Self(watch))
        }

        /// Whether there were any since the last call.
        pub(in super::super) fn any(&self) -> Result<bool, Errno> {
            match read(&self.0, &mut [0_u8; 4096]) {
                Ok(_) => Ok(true),
                Err(Errno::AGAIN | Errno::INTR) => Ok(false),
                Err(error) => Err(error),
            }
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod watched {
    use std::path::Path;

    use rustix::io::Errno;

    /// No events: on this system only a poll shows a closed port.
    #[derive(Debug)]
    pub(in super::super) struct Closings;

    impl Closings {
        /// Events from now on.
        pub(in super::super) fn of(_: &Path) -> Result<Self, Errno> {
            Ok(Self)
        }

        /// Whether there were any since the last call.
        pub(in super::super) fn any(&self) -> Result<bool, Errno> {
            Ok(false)
        }
    }
}

pub(super) use watched::Closings;
