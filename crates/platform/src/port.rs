//! Serial ports.

use std::time::Duration;

use serialport::{ClearBuffer, SerialPort};

use crate::Error;

/// Opens a port with this read timeout and discards its pending input, which was meant for an earlier reader.
pub(crate) fn open(name: &str, baud: u32, patience: Duration) -> Result<Box<dyn SerialPort>, Error> {
    let port = serialport::new(name, baud).timeout(patience).open();
    let cleared = port.and_then(|port| port.clear(ClearBuffer::Input).map(|()| port));
    cleared.map_err(|reason| Error::Open { port: name.into(), reason })
}
