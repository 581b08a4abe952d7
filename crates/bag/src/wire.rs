//! Serialisation of messages: ROS 1 (packed, little-endian) and ROS 2 (CDR of DDS, OMG formal/2002-06-51, 15.3).

use crate::error::DecodeError;

/// How messages are serialised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireFormat {
    /// ROS 1: packed fields.
    Ros1,
    /// ROS 2: CDR, where numbers are aligned to their size.
    Cdr,
    /// Protobuf, for Foxglove's schemas.
    Protobuf,
    /// Another encoding, which is not supported.
    Other,
}

/// A `std_msgs/Header`.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Time, nanoseconds.
    pub stamp_ns: i64,
    /// Name of the coordinate frame.
    pub frame_id: String,
}

/// Reads the fields of one message in order.
pub struct Wire<'a> {
    bytes: &'a [u8],
    at: usize,
    /// The position from which alignment is counted; `None` in ROS 1, which has no alignment.
    origin: Option<usize>,
    big_endian: bool,
}

macro_rules! number {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        ///
        /// # Errors
        /// When the message is too short.
        pub fn $name(&mut self) -> Result<$name, DecodeError> {
            const N: usize = std::mem::size_of::<$name>();
            self.align(N);
            let mut raw = [0; N];
            raw.copy_from_slice(self.take(N)?);
            Ok(if self.big_endian { $name::from_be_bytes(raw) } else { $name::from_le_bytes(raw) })
        }
    };
}

impl<'a> Wire<'a> {
    /// Starts to read a message.
    ///
    /// # Errors
    /// When the encoding is not supported.
    pub fn new(format: WireFormat, bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let plain = Self { bytes, at: 0, origin: None, big_endian: false };
        match format {
            WireFormat::Ros1 => Ok(plain),
            WireFormat::Cdr => match bytes {
                [0, kind @ (0 | 1), _, _, ..] => {
                    Ok(Self { at: 4, origin: Some(4), big_endian: *kind == 0, ..plain })
                }
                [a, b, _, _, ..] => Err(DecodeError::new(format!("CDR of kind {a:02x}{b:02x} is not read"))),
                _ => Err(DecodeError::new("shorter than the four bytes that begin CDR")),
            },
            WireFormat::Protobuf | WireFormat::Other => {
                Err(DecodeError::new("an encoding that is neither ROS 1 nor CDR"))
            }
        }
    }

    fn align(&mut self, n: usize) {
        if let Some(origin) = self.origin {
            self.at += (n - (self.at - origin) % n) % n;
        }
    }

    fn take(&mut self, n: usize) -> Result<&'a [u8], DecodeError> {
        let end = self.at.checked_add(n).filter(|end| *end <= self.bytes.len());
        let Some(end) = end else {
            let there = self.bytes.len().saturating_sub(self.at);
            return Err(DecodeError::new(format!("{n} bytes should follow, the message has {there} more")));
        };
        let out = &self.bytes[self.at..end];
        self.at = end;
        Ok(out)
    }

    number!(
        /// An unsigned 8-bit number.
        u8
    );
    number!(
        /// An unsigned 32-bit number.
        u32
    );
    number!(
        /// A signed 32-bit number.
        i32
    );
    number!(
        /// A 32-bit floating-point number.
        f32
    );
    number!(
        /// A 64-bit floating-point number.
        f64
    );

    /// `N` 64-bit floating-point numbers.
    ///
    /// # Errors
    /// When the message is too short.
    pub fn f64s<const N: usize>(&mut self) -> Result<[f64; N], DecodeError> {
        let mut out = [0.0; N];
        for v in &mut out {
            *v = self.f64()?;
        }
        Ok(out)
    }

    /// The length of a sequence whose items have at least `item` bytes each.
    ///
    /// # Errors
    /// When the rest of the message is too short for that many items.
    pub fn length(&mut self, item: usize) -> Result<usize, DecodeError> {
        let n = self.u32()? as usize;
        let there = self.bytes.len().saturating_sub(self.at);
        match n.checked_mul(item) {
            Some(bytes) if bytes <= there => Ok(n),
            _ => Err(DecodeError::new(format!("{n} items are stated, {there} bytes follow"))),
        }
    }

    /// A string.
    ///
    /// # Errors
    /// When the message is too short, or the text is not UTF-8.
    pub fn string(&mut self) -> Result<String, DecodeError> {
        let n = self.length(1)?;
        let mut bytes = self.take(n)?;
        if self.origin.is_some() {
            bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        }
        let text = std::str::from_utf8(bytes).map_err(|_| DecodeError::new("a text is not UTF-8"))?;
        Ok(text.to_owned())
    }

    /// A sequence of bytes.
    ///
    /// # Errors
    /// When the message is too short.
    pub fn bytes(&mut self) -> Result<&'a [u8], DecodeError> {
        let n = self.length(1)?;
        self.take(n)
    }

    /// A time in nanoseconds.
    ///
    /// # Errors
    /// When the message is too short.
    pub fn time(&mut self) -> Result<i64, DecodeError> {
        // Seconds are unsigned in ROS 1 and signed in ROS 2.
        let seconds = if self.origin.is_some() { i64::from(self.i32()?) } else { i64::from(self.u32()?) };
        Ok(seconds * 1_000_000_000 + i64::from(self.u32()?))
    }

    /// A `std_msgs/Header`.
    ///
    /// # Errors
    /// When the message is too short.
    pub fn header(&mut self) -> Result<Header, DecodeError> {
        if self.origin.is_none() {
            self.u32()?; // the sequence number of ROS 1
        }
        Ok(Header { stamp_ns: self.time()?, frame_id: self.string()? })
    }
}

/// The stamp of a message that begins with a header, from its first 16 bytes.
pub(crate) fn header_stamp(format: WireFormat, prefix: &[u8]) -> Option<i64> {
    if format == WireFormat::Protobuf {
        return crate::protobuf::first_stamp(prefix);
    }
    let mut wire = Wire::new(format, prefix).ok()?;
    if format == WireFormat::Ros1 {
        wire.u32().ok()?;
    }
    wire.time().ok()
}
