//! A disk whose free space can change, for unit and integration tests.

use super::{Durable, Medium};
use std::io;
use std::sync::{Arc, Mutex};

/// Its content, and its capacity in bytes.
#[derive(Clone, Default)]
pub struct Small(pub Arc<Mutex<(Vec<u8>, usize)>>);

impl io::Write for Small {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        let (kept, room) = &mut *self.0.lock().unwrap();
        let n = data.len().min(room.saturating_sub(kept.len()));
        if n == 0 {
            return Err(io::Error::new(io::ErrorKind::StorageFull, "no space left on device"));
        }
        kept.extend_from_slice(&data[..n]);
        Ok(n)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Durable for Small {
    fn make_durable(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Medium for Small {
    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.0.lock().unwrap().0.truncate(length as usize);
        Ok(())
    }
}
