//! Whether a port was closed, even where it was opened again at once: a poll tells only whether it is open now.

#[cfg(target_os = "linux")]
mod told {
    use std::os::fd::OwnedFd;
    use std::path::Path;

    use rustix::fs::inotify::{CreateFlags, WatchFlags, add_watch, init};
    use rustix::io::{Errno, read};

    /// What the system tells of a port.
    #[derive(Debug)]
    pub(in super::super) struct Closings(OwnedFd);

    impl Closings {
        /// From now on.
        pub(in super::super) fn of(port: &Path) -> Result<Self, Errno> {
            let told = init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)?;
            add_watch(&told, port, WatchFlags::CLOSE_WRITE | WatchFlags::CLOSE_NOWRITE)?;
            Ok(Self(told))
        }

        /// Whether there were any since this was asked before.
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
mod told {
    use std::path::Path;

    use rustix::io::Errno;

    /// Nothing: the system tells only who polls in time.
    #[derive(Debug)]
    pub(in super::super) struct Closings;

    impl Closings {
        /// From now on.
        pub(in super::super) fn of(_: &Path) -> Result<Self, Errno> {
            Ok(Self)
        }

        /// Whether there were any since this was asked before.
        pub(in super::super) fn any(&self) -> Result<bool, Errno> {
            Ok(false)
        }
    }
}

pub(super) use told::Closings;
