//! Serial ports.

use std::time::Duration;

use serialport::{ClearBuffer, SerialPort};

use crate::Error;

/// Opens a port whose reads wait for so long. What a device said to somebody else before is not read.
pub(crate) fn open(name: &str, baud: u32, patience: Duration) -> Result<Box<dyn SerialPort>, Error> {
    let port = serialport::new(name, baud).timeout(patience).open();
    let cleared = port.and_then(|port| port.clear(ClearBuffer::Input).map(|()| port));
    cleared.map_err(|reason| Error::Open { port: name.into(), reason })
}
