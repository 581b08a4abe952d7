//! Reading of little-endian messages that may be cut off or damaged.

/// A message that is not what it says it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// It ends within a number.
    #[error("a message of the map is cut off")]
    Short,
    /// Bytes follow its end.
    #[error("a message of the map has {0} bytes too many")]
    Long(usize),
    /// A corner of a triangle that no vertex has, or a block of a submap that is not there.
    #[error("a message of the map names something that is not there")]
    Dangling,
    /// A kind that is not known.
    #[error(
        "a message of kind {0}, which this program does not know: use the versions of cairn and cairn-view that belong together"
    )]
    Kind(u8),
}

/// The rest of a message.
pub(crate) struct Reader<'a>(pub &'a [u8]);

impl Reader<'_> {
    pub fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        let (head, rest) = self.0.split_first_chunk::<N>().ok_or(Malformed::Short)?;
        self.0 = rest;
        Ok(*head)
    }

    pub fn byte(&mut self) -> Result<u8, Malformed> {
        Ok(self.bytes::<1>()?[0])
    }

    pub fn number(&mut self) -> Result<u32, Malformed> {
        self.bytes().map(u32::from_le_bytes)
    }

    pub fn signed(&mut self) -> Result<i32, Malformed> {
        self.bytes().map(i32::from_le_bytes)
    }

    pub fn short(&mut self) -> Result<u16, Malformed> {
        self.bytes().map(u16::from_le_bytes)
    }

    pub fn float(&mut self) -> Result<f32, Malformed> {
        self.bytes().map(f32::from_le_bytes)
    }

    pub fn floats<const N: usize>(&mut self) -> Result<[f32; N], Malformed> {
        let mut out = [0.0; N];
        for v in &mut out {
            *v = self.float()?;
        }
        Ok(out)
    }

    /// A list with its count in front.
    pub fn each(&mut self, mut f: impl FnMut(&mut Self) -> Result<(), Malformed>) -> Result<(), Malformed> {
        for _ in 0..self.number()? {
            f(self)?;
        }
        Ok(())
    }

    /// Nothing may be left.
    pub fn end(self) -> Result<(), Malformed> {
        if self.0.is_empty() { Ok(()) } else { Err(Malformed::Long(self.0.len())) }
    }
}
